//! Instruction paths of the CPU kernels, chosen at run time.
//!
//! A kernel is written once as an `#[inline(always)]` function over fixed-size arrays and compiled for
//! each path by the macro `multiversioned!`; rustc vectorises the loops. Fused multiply-adds round differently
//! from separate ones, so different paths give different last bits; one path always gives the same.

#![allow(unsafe_code, reason = "calls of functions compiled for instructions that were detected")]

use std::fmt;

/// An instruction path that this machine can run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Isa(Path);

/// What an [`Isa`] names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Path {
    /// Vectors of sixteen lanes (x86-64).
    Avx512,
    /// Vectors of eight lanes, fused products (x86-64).
    Avx2,
    /// What every machine of this kind has.
    Baseline,
    /// Pixel by pixel, as the reference for the others.
    Scalar,
}

impl Isa {
    /// The fastest path of this machine.
    pub fn detect() -> Self {
        Self::available()[0]
    }

    /// All paths of this machine, fastest first; `scalar` is the plain per-pixel loop that benches compare with.
    pub fn available() -> Vec<Self> {
        let mut paths = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            let avx512 = avx2
                && is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512vl");
            if avx512 {
                paths.push(Self(Path::Avx512));
            }
            if avx2 {
                paths.push(Self(Path::Avx2));
            }
        }
        paths.extend([Self(Path::Baseline), Self(Path::Scalar)]);
        paths
    }

    /// The path of that name, when this machine has it.
    ///
    /// ```
    /// # use quadrille_base as quadrille;
    /// use quadrille::isa::Isa;
    /// assert!(Isa::named("baseline").is_some());
    /// assert!(Isa::named("abacus").is_none());
    /// ```
    pub fn named(name: &str) -> Option<Self> {
        Self::available().into_iter().find(|isa| isa.name() == name)
    }

    /// Name used in options and files: `avx512`, `avx2`, `baseline` or `scalar`.
    pub fn name(self) -> &'static str {
        match self.0 {
            Path::Avx512 => "avx512",
            Path::Avx2 => "avx2",
            Path::Baseline => "baseline",
            Path::Scalar => "scalar",
        }
    }

    /// The path for work that is mostly shuffles: eight lanes shuffle faster than sixteen, to the same bits.
    pub fn for_shuffles(self) -> Self {
        if self.0 == Path::Avx512 { Self(Path::Avx2) } else { self }
    }

    /// Which of the paths it is.
    pub fn path(self) -> Path {
        self.0
    }
}

impl fmt::Display for Isa {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// `a * b + c`, fused where the path has the instruction (calling it elsewhere would be a slow library call).
#[inline(always)]
pub fn mul_add<const FMA: bool>(a: f32, b: f32, c: f32) -> f32 {
    if FMA { a.mul_add(b, c) } else { a * b + c }
}

/// Compiles `$body::<FMA, generics...>` for every instruction path and calls the one that `isa` names. Each path is a
/// module: the compiler works on modules side by side, and one kernel takes it longer than all the rest of a crate.
#[doc(hidden)]
#[macro_export]
macro_rules! multiversioned {
    ($(#[$attr:meta])* $vis:vis fn $name:ident [$($decl:tt)*] [$($gen:ident),*] ($($arg:ident : $ty:ty),* $(,)?) $(-> $ret:ty)? => $body:ident) => {
        #[allow(unused_imports, clippy::too_many_arguments, reason = "of what the kernels have in common")]
        mod $name {
            #[cfg(target_arch = "x86_64")]
            pub(super) mod avx512 {
                use super::super::*;
                #[target_feature(enable = "avx512f,avx512dq,avx512bw,avx512vl,avx2,fma")]
                pub(in super::super) fn run<$($decl)*>($($arg: $ty),*) $(-> $ret)? { $body::<true, $($gen),*>($($arg),*) }
            }
            #[cfg(target_arch = "x86_64")]
            pub(super) mod avx2 {
                use super::super::*;
                #[target_feature(enable = "avx2,fma")]
                pub(in super::super) fn run<$($decl)*>($($arg: $ty),*) $(-> $ret)? { $body::<true, $($gen),*>($($arg),*) }
            }
            pub(super) mod baseline {
                use super::super::*;
                pub(in super::super) fn run<$($decl)*>($($arg: $ty),*) $(-> $ret)? {
                    $body::<{ cfg!(target_arch = "aarch64") }, $($gen),*>($($arg),*)
                }
            }
        }
        $(#[$attr])*
        #[allow(clippy::too_many_arguments, reason = "as many as the kernel has")]
        $vis fn $name<$($decl)*>(isa: $crate::isa::Isa, $($arg: $ty),*) $(-> $ret)? {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code, reason = "see `isa`")]
            match isa.path() {
                // SAFETY: an `Isa` of this kind is made only after its features were detected.
                $crate::isa::Path::Avx512 => return unsafe { $name::avx512::run::<$($gen),*>($($arg),*) },
                // SAFETY: as above.
                $crate::isa::Path::Avx2 => return unsafe { $name::avx2::run::<$($gen),*>($($arg),*) },
                _ => {}
            }
            let _ = isa;
            $name::baseline::run::<$($gen),*>($($arg),*)
        }
    };
}

pub use multiversioned;
