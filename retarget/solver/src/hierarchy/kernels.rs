//! Inner loops over padded rows. Written so that the compiler vectorises them; on x86-64 a second
//! copy with AVX2 and FMA is chosen at run time. Row lengths are multiples of 8.

#[cfg(target_arch = "x86_64")]
pub fn has_fma() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

#[cfg(not(target_arch = "x86_64"))]
pub fn has_fma() -> bool {
    false
}

#[inline(always)]
fn multiply_add<const FMA: bool>(a: f64, b: f64, c: f64) -> f64 {
    if FMA {
        a.mul_add(b, c)
    } else {
        a * b + c
    }
}

/// Inner product of two padded rows.
#[inline(always)]
pub fn dot<const FMA: bool>(a: &[f64], b: &[f64]) -> f64 {
    let mut sum = [0.0; 8];
    for (x, y) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..8 {
            sum[k] = multiply_add::<FMA>(x[k], y[k], sum[k]);
        }
    }
    ((sum[0] + sum[4]) + (sum[2] + sum[6])) + ((sum[1] + sum[5]) + (sum[3] + sum[7]))
}

/// a <- a + s b
#[inline(always)]
pub fn add_scaled<const FMA: bool>(a: &mut [f64], s: f64, b: &[f64]) {
    for (x, y) in a.chunks_exact_mut(8).zip(b.chunks_exact(8)) {
        for k in 0..8 {
            x[k] = multiply_add::<FMA>(s, y[k], x[k]);
        }
    }
}
