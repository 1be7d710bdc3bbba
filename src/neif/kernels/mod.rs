//! Arithmetic kernels of the fields: portable bodies over fixed-size blocks, compiled once an instruction set.
//!
//! Each kernel is one `#[inline(always)]` body, generic over its [`Isa`]. [`dispatch`] compiles it for the baseline
//! target, under `#[target_feature(enable = "avx2,fma")]` and for AVX-512, and picks at run time. Hand-written
//! intrinsics measured no faster than such bodies; the plain loops in the tests are the oracle. The fused versions
//! give the same bits, the baseline differs in the last ones (unfused rounding): the same seed gives the same bits
//! on machines of the same kind.

pub mod math;
pub mod matmul;
pub mod peak;

/// Instructions that a kernel's body is compiled for.
pub trait Isa {
    /// Whether `a * b + c` is one instruction.
    const FMA: bool;
    /// Whether a register holds sixteen floats and there are thirty-two of them.
    const WIDE: bool = false;
}

/// What every machine of the target has.
#[derive(Clone, Copy, Debug)]
pub struct Baseline;
/// 256-bit registers and fused multiply-add.
#[derive(Clone, Copy, Debug)]
pub struct Avx2;
/// 512-bit registers.
#[derive(Clone, Copy, Debug)]
pub struct Avx512;

impl Isa for Baseline {
    const FMA: bool = cfg!(target_arch = "aarch64");
}

impl Isa for Avx2 {
    const FMA: bool = true;
}

impl Isa for Avx512 {
    const FMA: bool = true;
    const WIDE: bool = true;
}

/// `a * b + c`, fused where the instruction exists; `f32::mul_add` without it is a slow library call.
#[inline(always)]
pub fn fma<I: Isa>(a: f32, b: f32, c: f32) -> f32 {
    if I::FMA { a.mul_add(b, c) } else { a * b + c }
}

/// The instructions that kernels use on this machine.
pub fn instructions() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    if has_avx512() {
        return "AVX-512";
    } else if has_avx2() {
        return "AVX2 and FMA";
    }
    "baseline"
}

/// Whether the 256-bit versions run on this machine.
#[cfg(target_arch = "x86_64")]
pub(crate) fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

/// Whether the 512-bit versions run on this machine.
#[cfg(target_arch = "x86_64")]
pub(crate) fn has_avx512() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512bw")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && has_avx2()
}

/// Defines `$name` as the run-time choice between the versions of the generic body `$body`.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident : $type:ty),* $(,)?) $(-> $ret:ty)? = $body:ident) => {
        $(#[$meta])*
        $vis fn $name($($arg: $type),*) $(-> $ret)? {
            use $crate::neif::kernels;
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
                fn widest($($arg: $type),*) $(-> $ret)? {
                    $body::<kernels::Avx512>($($arg),*)
                }
                #[target_feature(enable = "avx2,fma")]
                fn wide($($arg: $type),*) $(-> $ret)? {
                    $body::<kernels::Avx2>($($arg),*)
                }
                if kernels::has_avx512() {
                    // SAFETY: `has_avx512` just found every feature that `widest` needs.
                    #[expect(unsafe_code, reason = "a call into code compiled for more features than the baseline")]
                    return unsafe { widest($($arg),*) };
                }
                if kernels::has_avx2() {
                    // SAFETY: `has_avx2` just found every feature that `wide` needs.
                    #[expect(unsafe_code, reason = "a call into code compiled for more features than the baseline")]
                    return unsafe { wide($($arg),*) };
                }
            }
            $body::<kernels::Baseline>($($arg),*)
        }
    };
}
pub(crate) use dispatch;
