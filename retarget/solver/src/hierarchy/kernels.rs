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

/// `name(fma, ...)` runs its body with `FMA` true where the processor has it, else false: compiled once for each, for its
/// instructions. The body may call other functions as `f::<FMA>(...)`, which are to be inlined.
macro_rules! compile_twice {
    ($(#[$doc:meta])* $vis:vis fn $name:ident($($arg:ident: $type:ty),* $(,)?) $(-> $out:ty)? $body:block) => {
        $(#[$doc])*
        $vis fn $name(fma: bool, $($arg: $type),*) $(-> $out)? {
            #[inline(always)]
            fn body<const FMA: bool>($($arg: $type),*) $(-> $out)? $body

            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx2,fma")]
                unsafe fn with_fma($($arg: $type),*) $(-> $out)? {
                    body::<true>($($arg),*)
                }
                if fma {
                    // SAFETY: `fma` is true only where the processor has AVX2 and FMA.
                    return unsafe { with_fma($($arg),*) };
                }
            }
            let _ = fma;
            body::<{ cfg!(target_arch = "aarch64") }>($($arg),*)
        }
    };
}
pub(super) use compile_twice;

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
    let (mut even, mut odd) = ([0.0; 4], [0.0; 4]);
    for (x, y) in a.chunks_exact(8).zip(b.chunks_exact(8)) {
        for k in 0..4 {
            even[k] = multiply_add::<FMA>(x[k], y[k], even[k]);
        }
        for k in 0..4 {
            odd[k] = multiply_add::<FMA>(x[k + 4], y[k + 4], odd[k]);
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
pub fn add_scaled4<const FMA: bool>(a: &mut [f64], s: [f64; 4], rows: &[f64]) {
    let n = a.len();
    let (r0, rest) = rows.split_at(n);
    let (r1, rest) = rest.split_at(n);
    let (r2, rest) = rest.split_at(n);
    let r3 = &rest[..n];
    let chunks = a.chunks_exact_mut(4).zip(r0.chunks_exact(4)).zip(r1.chunks_exact(4));
    for (((x, y0), y1), (y2, y3)) in chunks.zip(r2.chunks_exact(4).zip(r3.chunks_exact(4))) {
        let mut sum = [0.0; 4];
        for k in 0..4 {
            let low = multiply_add::<FMA>(s[1], y1[k], multiply_add::<FMA>(s[0], y0[k], x[k]));
            sum[k] = low + multiply_add::<FMA>(s[3], y3[k], s[2] * y2[k]);
        }
        x.copy_from_slice(&sum);
    }
}

/// out[j] = a . row j, for `count` rows one after another.
#[inline(always)]
pub fn dot_rows<const FMA: bool>(a: &[f64], rows: &[f64], out: &mut [f64]) {
    let n = a.len();
    for (value, row) in out.iter_mut().zip(rows.chunks_exact(n)) {
        *value = dot::<FMA>(a, row);
    }
}

/// a <- a + sign * sum_j s[j] row j
#[inline(always)]
pub fn add_rows<const FMA: bool>(a: &mut [f64], sign: f64, s: &[f64], rows: &[f64]) {
    let n = a.len();
    let count = s.len();
    let mut j = 0;
    while j + 4 <= count {
        let four = [sign * s[j], sign * s[j + 1], sign * s[j + 2], sign * s[j + 3]];
        add_scaled4::<FMA>(a, four, &rows[j * n..(j + 4) * n]);
        j += 4;
    }
    for j in j..count {
        add_scaled::<FMA>(a, sign * s[j], &rows[j * n..(j + 1) * n]);
    }
}

/// a <- a + s b
#[inline(always)]
pub fn add_scaled<const FMA: bool>(a: &mut [f64], s: f64, b: &[f64]) {
    for (x, y) in a.chunks_exact_mut(8).zip(b.chunks_exact(8)) {
        let mut sum = [0.0; 8];
        for k in 0..8 {
            sum[k] = multiply_add::<FMA>(s, y[k], x[k]);
        }
        x.copy_from_slice(&sum);
    }
}
