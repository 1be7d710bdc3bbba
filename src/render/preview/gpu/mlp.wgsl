// A network with one hidden layer of ReLUs (`neif/networks/mlp.rs`), one input in registers.
//
// A pattern that is made once a network: NAME stands for it, INPUTS and OUTPUTS for its widths in fours, HIDDEN for its
// hidden width, BINDING for its place. A hidden unit's rows are its input weights, its output weights and its bias, so
// that all threads read one stream; the output's biases come last.

@group(0) @binding(BINDING) var<storage, read> NAME_weights: array<vec4<f32>>;

fn NAME_network(input: ptr<function, array<vec4<f32>, INPUTS>>) -> array<vec4<f32>, OUTPUTS> {
    var output: array<vec4<f32>, OUTPUTS>;
    const stride = INPUTSu + OUTPUTSu + 1u;
    for (var i = 0u; i < OUTPUTSu; i++) {
        output[i] = NAME_weights[stride * HIDDENu + i];
    }
    for (var unit = 0u; unit < HIDDENu; unit++) {
        let first = unit * stride;
        var sum = NAME_weights[first + INPUTSu + OUTPUTSu];
        for (var i = 0u; i < INPUTSu; i++) {
            sum += NAME_weights[first + i] * (*input)[i];
        }
        let value = max(sum.x + sum.y + (sum.z + sum.w), 0.0);
        for (var i = 0u; i < OUTPUTSu; i++) {
            output[i] += value * NAME_weights[first + INPUTSu + i];
        }
    }
    return output;
}
