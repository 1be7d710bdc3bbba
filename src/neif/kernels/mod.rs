//! Arithmetic kernels of the fields: portable bodies over fixed-size blocks, compiled twice.
//!
//! Each kernel is one `#[inline(always)]` body, generic over `FMA`. [`dispatch`] compiles it once for
//! the baseline target and once under `#[target_feature(enable = "avx2,fma")]`, and picks at run time.
//! Hand-written intrinsics measured no faster than such bodies; the plain loops in the tests are the
//! oracle. Results of the two versions differ in the last bits (fused rounding), so the same seed gives
//! the same bits on machines of the same kind, not across kinds.

pub mod math;
pub mod matmul;
pub mod peak;

/// `a * b + c`, fused where the instruction exists; `f32::mul_add` without it is a slow library call.
#[inline(always)]
pub fn fma<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Whether the fused 256-bit versions run on this machine.
pub fn has_fma() -> bool {
    #[cfg(target_arch = "x86_64")]
    {
        is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
    }
    #[cfg(not(target_arch = "x86_64"))]
    {
        cfg!(target_arch = "aarch64")
    }
}

/// Defines `$name` as the run-time choice between the versions of the generic body `$body`.
macro_rules! dispatch {
    ($(#[$meta:meta])* $vis:vis fn $name:ident($($arg:ident : $type:ty),* $(,)?) $(-> $ret:ty)? = $body:ident) => {
        $(#[$meta])*
        $vis fn $name($($arg: $type),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                fn wide($($arg: $type),*) $(-> $ret)? {
                    $body::<true>($($arg),*)
                }
                if $crate::neif::kernels::has_fma() {
                    // SAFETY: `wide` needs AVX2 and FMA only, and `has_fma` just found both.
                    #[expect(unsafe_code, reason = "a call into code compiled for more features than the baseline")]
                    return unsafe { wide($($arg),*) };
                }
                $body::<false>($($arg),*)
            }
            #[cfg(not(target_arch = "x86_64"))]
            {
                $body::<{ cfg!(target_arch = "aarch64") }>($($arg),*)
            }
        }
    };
}
pub(crate) use dispatch;
