//! Inner loops over padded rows. Row lengths are multiples of 8.
//!
//! The order of additions is written out, in lanes, and no product is fused with a sum, so that every processor finds the same
//! bits. The compiler vectorises the lanes; on x86-64 a second copy with AVX2 is chosen at run time, which is faster and equal.

/// True where the copies with AVX2 are to run. The feature `portable` turns them off, for tests.
pub fn has_avx2() -> bool {
    #[cfg(all(target_arch = "x86_64", not(feature = "portable")))]
    return is_x86_feature_detected!("avx2");
    #[cfg(not(all(target_arch = "x86_64", not(feature = "portable"))))]
    return false;
}

/// `name(avx2, ...)` runs its body compiled for AVX2 if `avx2`, else compiled for any processor. Functions that the body calls are
/// compiled along with it where they are inlined.
macro_rules! compile_twice {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name(avx2: bool, $($arg: $type),*) $(-> $out)? {
            #[inline(always)]
            fn body($($arg: $type),*) $(-> $out)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2")]
                unsafe fn with_avx2($($arg: $type),*) $(-> $out)? {
                    body($($arg),*)
                }
                if avx2 {
                    // SAFETY: `avx2` is true only where the processor has AVX2.
                    return unsafe { with_avx2($($arg),*) };
                }
            }
            let _ = avx2;
            body($($arg),*)
        }
    };
}
pub(crate) use compile_twice;

/// Inner product of two padded rows.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let (mut even, mut odd) = ([0.0; 4], [0.0; 4]);
    for (x, y) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..4 {
            even[k] += x[k] * y[k];
        }
        for k in 0..4 {
            odd[k] += x[k + 4] * y[k + 4];
        }
    }
    let mut sum = [0.0; 4];
    for k in 0..4 {
        sum[k] = even[k] + odd[k];
    }
    (sum[0] + sum[2]) + (sum[1] + sum[3])
}

/// a <- a + s . (the first four rows of `rows`)
#[inline(always)]
pub fn add_scaled4(a: &mut [f64], s: [f64; 4], rows: &[f64]) {
    let n = a.len();
    let (r0, rest) = rows.split_at(n);
    let (r1, rest) = rest.split_at(n);
    let (r2, rest) = rest.split_at(n);
    let r3 = &rest[..n];
    let chunks = a.chunks_exact_mut(4).zip(r0.chunks_exact(4)).zip(r1.chunks_exact(4));
    for (((x, y0), y1), (y2, y3)) in chunks.zip(r2.chunks_exact(4).zip(r3.chunks_exact(4))) {
        let mut sum = [0.0; 4];
        for k in 0..4 {
            sum[k] = (x[k] + s[0] * y0[k] + s[1] * y1[k]) + (s[2] * y2[k] + s[3] * y3[k]);
        }
        x.copy_from_slice(&sum);
    }
}

/// out[j] = a . row j, for `count` rows one after another.
#[inline(always)]
pub fn dot_rows(a: &[f64], rows: &[f64], out: &mut [f64]) {
    let n = a.len();
    for (value, row) in out.iter_mut().zip(rows.chunks_exact(n)) {
        *value = dot(a, row);
    }
}

/// a <- a + sign * sum_j s[j] row j
#[inline(always)]
pub fn add_rows(a: &mut [f64], sign: f64, s: &[f64], rows: &[f64]) {
    let n = a.len();
    let count = s.len();
    let mut j = 0;
    while j + 4 <= count {
        let four = [sign * s[j], sign * s[j + 1], sign * s[j + 2], sign * s[j + 3]];
        add_scaled4(a, four, &rows[j * n..(j + 4) * n]);
        j += 4;
    }
    for j in j..count {
        add_scaled(a, sign * s[j], &rows[j * n..(j + 1) * n]);
    }
}

/// a <- a + s b
#[inline(always)]
pub fn add_scaled(a: &mut [f64], s: f64, b: &[f64]) {
    for (x, y) in a.chunks_exact_mut(8).zip(b.chunks_exact(8)) {
        let mut sum = [0.0; 8];
        for k in 0..8 {
            sum[k] = x[k] + s * y[k];
        }
        x.copy_from_slice(&sum);
    }
}
