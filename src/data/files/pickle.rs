//! Python pickles of numpy arrays in tuples, lists and dictionaries, read without running anything.
//!
//! The names of functions are looked up in a list of four that numpy writes, and anything else is an error.

use super::npy::{Array, Kind};
use super::pickle_machine::{Object, Place, Unpickled, Value, unpickle};

/// Bytes of the largest pickle read; a camera has 500.
pub(in crate::data) const MAX_BYTES: u64 = 1 << 20;
/// Values looked at in the result: a list may hold itself, or one list a thousand times over.
const MAX_VISITS: usize = 1000;

/// What numpy's functions make.
#[derive(Clone, Debug)]
enum Made {
    /// An array whose numbers are yet to come.
    Blank,
    Kind(Kind),
    Array(Array),
}

/// The arrays in a pickle, in the order in which they lie in its tuples, lists and dictionaries; or what is wrong with it.
pub(in crate::data) fn arrays(bytes: &[u8]) -> Result<Vec<Array>, String> {
    let unpickled = unpickle(bytes)?;
    let (mut found, mut n_left) = (Vec::new(), MAX_VISITS);
    collect(&unpickled, unpickled.top, &mut n_left, &mut found)?;
    Ok(found)
}

impl Object for Made {
    fn call(
        name: &str,
        arguments: &[&Value<Self>],
        values: &[Value<Self>],
    ) -> Result<Value<Self>, String> {
        // numpy 2 has moved them.
        let name = name.replace("numpy._core.", "numpy.core.");
        let made = match (name.as_str(), arguments) {
            ("numpy.core.multiarray._reconstruct", _) => Self::Blank,
            ("numpy.dtype", [Value::Text(kind), ..]) => Self::Kind(Kind::of(kind)?),
            ("numpy.dtype", [Value::Bytes(kind), ..]) => {
                Self::Kind(Kind::of(&String::from_utf8_lossy(kind))?)
            }
            // Bytes in older protocols, as a text of their codes.
            ("_codecs.encode", [Value::Text(text), ..]) => {
                let bytes = text.chars().map(|c| u8::try_from(u32::from(c)));
                let bytes: Result<Vec<u8>, _> = bytes.collect();
                let bytes = bytes.map_err(|_not_latin1| "bytes are no bytes")?;
                return Ok(Value::Bytes(bytes));
            }
            (
                "numpy.core.numeric._frombuffer",
                [
                    Value::Bytes(bytes),
                    Value::Object(Self::Kind(kind)),
                    sides,
                    order,
                ],
            ) => {
                let is_fortran = matches!(order, Value::Text(order) if order == "F");
                Self::Array(kind.array(&shape(sides, values)?, is_fortran, bytes)?)
            }
            _ => {
                return Err(format!(
                    "it calls {name}, and functions in pickles are not run"
                ));
            }
        };
        Ok(Value::Object(made))
    }

    /// Gives an array its numbers, or a kind of number its order of bytes.
    fn build(
        target: &Value<Self>,
        state: &[&Value<Self>],
        values: &[Value<Self>],
    ) -> Result<Option<Value<Self>>, String> {
        let made = match (target, state) {
            (
                Value::Object(Self::Blank),
                [
                    _,
                    sides,
                    Value::Object(Self::Kind(kind)),
                    order,
                    Value::Bytes(bytes),
                ],
            ) => {
                let is_fortran = matches!(order, Value::Int(1));
                Self::Array(kind.array(&shape(sides, values)?, is_fortran, bytes)?)
            }
            (Value::Object(Self::Kind(kind)), [_, Value::Text(order), ..]) => {
                Self::Kind(kind.in_order(order.as_bytes()))
            }
            (Value::Object(Self::Kind(kind)), [_, Value::Bytes(order), ..]) => {
                Self::Kind(kind.in_order(order))
            }
            _ => return Err("the state of an array is none that is known".to_owned()),
        };
        Ok(Some(Value::Object(made)))
    }

    fn persistent(_id: &[&Value<Self>]) -> Result<Value<Self>, String> {
        Err("it names what is in no pickle".to_owned())
    }
}

fn shape(sides: &Value<Made>, values: &[Value<Made>]) -> Result<Vec<usize>, String> {
    let sides = sides.shape(values);
    sides.ok_or_else(|| "the shape of an array is none".to_owned())
}

/// Adds the arrays of a value; `n_left`: values that may still be looked at.
fn collect(
    unpickled: &Unpickled<Made>,
    place: Place,
    n_left: &mut usize,
    found: &mut Vec<Array>,
) -> Result<(), String> {
    *n_left = n_left
        .checked_sub(1)
        .ok_or("lists within lists without end")?;
    match &unpickled.values[place] {
        Value::Object(Made::Array(array)) => found.push(array.clone()),
        Value::Items(items) => {
            for item in items {
                collect(unpickled, *item, n_left, found)?;
            }
        }
        _ => {}
    }
    Ok(())
}

#[cfg(test)]
pub(in crate::data) mod tests {
    use super::*;

    // What Python 3 with numpy 2 writes for a tuple of `POSE` as float32 and `LENS` as float64, in three protocols.
    const PROTOCOL_2: &str = "8002636e756d70792e5f636f72652e6d756c746961727261790a5f7265636f6e7374727563740a7100636e756d70790a6e646172 \
     7261790a71014b00857102635f636f646563730a656e636f64650a7103580100000062710458060000006c6174696e3171058671 \
     06527107877108527109284b014b034b0486710a636e756d70790a64747970650a710b58020000006634710c898887710d52710e \
     284b0358010000003c710f4e4e4e4affffffff4affffffff4b007471106289680358370000000000c2803f000000000000000000 \
     00c2803e000000000000c280c2bf00000000000000c2bf00000000000000000000c280c2bf000000407111680586711252711374 \
     711462680068014b008571156807877116527117284b014b034b03867118680b580200000066387119898887711a52711b284b03 \
     680f4e4e4e4affffffff4affffffff4b0074711c62896803584a0000000000000000407f40000000000000000000000000000079 \
     4000000000000000000000000000407f400000000000c380724000000000000000000000000000000000000000000000c3b03f71 \
     1d680586711e52711f747120628671212e";
    pub(in crate::data) const PROTOCOL_4: &str = "80049547010000000000008c166e756d70792e5f636f72652e6d756c74696172726179948c0c5f7265636f6e7374727563749493 \
     948c056e756d7079948c076e6461727261799493944b0085944301629487945294284b014b034b04869468038c05647479706594 \
     93948c02663494898887945294284b038c013c944e4e4e4affffffff4affffffff4b007494628943300000803f00000000000000 \
     000000803e00000000000080bf00000000000000bf0000000000000000000080bf0000004094749462680268054b008594680787 \
     945294284b014b034b038694680c8c02663894898887945294284b0368104e4e4e4affffffff4affffffff4b0074946289434800 \
     00000000407f400000000000000000000000000000794000000000000000000000000000407f400000000000c072400000000000 \
     0000000000000000000000000000000000f03f9474946286942e";
    const PROTOCOL_5: &str = "8005952d010000000000008c136e756d70792e5f636f72652e6e756d65726963948c0b5f66726f6d627566666572949394289630 \
     000000000000000000803f00000000000000000000803e00000000000080bf00000000000000bf0000000000000000000080bf00 \
     000040948c056e756d7079948c0564747970659493948c02663494898887945294284b038c013c944e4e4e4affffffff4affffff \
     ff4b007494624b034b0486948c014394749452946802289648000000000000000000000000407f40000000000000000000000000 \
     0000794000000000000000000000000000407f400000000000c0724000000000000000000000000000000000000000000000f03f \
     9468068c02663894898887945294284b03680a4e4e4e4affffffff4affffffff4b007494624b034b038694680d7494529486942e";
    // A list, the pose with its first index running fastest.
    const FORTRAN: &str = "80049549010000000000005d94288c166e756d70792e5f636f72652e6d756c74696172726179948c0c5f7265636f6e7374727563 \
     749493948c056e756d7079948c076e6461727261799493944b0085944301629487945294284b014b034b04869468048c05647479 \
     70659493948c02663494898887945294284b038c013c944e4e4e4affffffff4affffffff4b007494628843300000803f00000000 \
     0000000000000000000080bf000000000000000000000000000080bf0000803e000000bf0000004094749462680368064b008594 \
     680887945294284b014b034b038694680d8c02663894898887945294284b0368114e4e4e4affffffff4affffffff4b0074946289 \
     43480000000000407f400000000000000000000000000000794000000000000000000000000000407f400000000000c072400000 \
     0000000000000000000000000000000000000000f03f94749462652e";
    pub(in crate::data) const POSE: [f64; 12] = [
        1.0, 0.0, 0.0, 0.25, 0.0, -1.0, 0.0, -0.5, 0.0, 0.0, -1.0, 2.0,
    ];
    pub(in crate::data) const LENS: [f64; 9] =
        [500.0, 0.0, 400.0, 0.0, 500.0, 300.0, 0.0, 0.0, 1.0];

    pub(in crate::data) fn bytes_of(hex: &str) -> Vec<u8> {
        let digits: Vec<u32> = hex.chars().filter_map(|c| c.to_digit(16)).collect();
        let pairs = digits.chunks_exact(2);
        pairs.map(|pair| (16 * pair[0] + pair[1]) as u8).collect()
    }

    #[test]
    fn arrays_of_every_protocol_are_read() {
        for hex in [PROTOCOL_2, PROTOCOL_4, PROTOCOL_5, FORTRAN] {
            let arrays = arrays(&bytes_of(hex)).unwrap();
            assert_eq!(arrays.len(), 2, "a pose and a lens");
            for (array, shape, values) in
                [(&arrays[0], [3, 4], &POSE[..]), (&arrays[1], [3, 3], &LENS)]
            {
                assert_eq!((&array.shape[..], &array.values[..]), (&shape[..], values));
            }
        }
    }

    #[test]
    fn programs_are_not_run() {
        // os.system("true"), as `pickle` would write it.
        let program = b"\x80\x02cposix\nsystem\nX\x04\0\0\0true\x85R.";
        let problem = arrays(program).unwrap_err();
        assert!(problem.contains("posix.system"), "{problem}");
        let object = b"\x80\x02c__main__\nX\n)\x81.";
        assert!(
            arrays(object).unwrap_err().contains("__main__.X"),
            "objects"
        );
    }

    #[test]
    fn pickles_that_are_cut_or_bent_are_errors_or_smaller() {
        for hex in [PROTOCOL_2, PROTOCOL_4, PROTOCOL_5] {
            let whole = bytes_of(hex);
            for n in 0..whole.len() {
                assert!(arrays(&whole[..n]).is_err(), "cut at {n}");
                for bit in 0..8 {
                    let mut bent = whole.clone();
                    bent[n] ^= 1 << bit;
                    if let Ok(arrays) = arrays(&bent) {
                        let n_values: usize = arrays.iter().map(|a| a.values.len()).sum();
                        assert!(n_values <= whole.len(), "bit {bit} of {n}");
                    }
                }
            }
        }
    }

    #[test]
    fn lists_that_hold_themselves_come_to_an_end() {
        // x = []; x.append(x)
        assert!(arrays(b"]q\0h\0a.").is_err(), "itself");
        // Each level holds the one below a hundred times.
        let mut bytes = b"]q\0".to_vec();
        for level in 1..8_u8 {
            bytes.extend([b']', b'q', level, b'(']);
            bytes.extend([b'h', level - 1].repeat(100));
            bytes.push(b'e');
        }
        bytes.push(b'.');
        assert!(arrays(&bytes).is_err(), "without end");
    }
}
