//! Kernels find the same bits compiled for AVX2, compiled for any processor, and in the order of additions that is written here.

use super::random::Random;
use crate::hierarchy::kernels::{add_rows, add_scaled, compile_twice, dot};

compile_twice! {
    fn everything(a: &mut [f64], s: &[f64], rows: &[f64]) -> f64 {
        add_rows(a, -1.0, s, rows);
        add_scaled(a, 0.3, &rows[..a.len()]);
        dot(a, rows)
    }
}

/// The same, one number after the other.
fn by_hand(a: &mut [f64], s: &[f64], rows: &[f64]) -> f64 {
    let n = a.len();
    let product = |j: usize, k: usize| -s[j] * rows[j * n + k];
    for (k, x) in a.iter_mut().enumerate() {
        let mut j = 0;
        while j + 4 <= s.len() {
            *x = (*x + product(j, k) + product(j + 1, k)) + (product(j + 2, k) + product(j + 3, k));
            j += 4;
        }
        for j in j..s.len() {
            *x += product(j, k);
        }
        *x += 0.3 * rows[k];
    }
    let mut lanes = [0.0; 8];
    for k in 0..n {
        lanes[k % 8] += a[k] * rows[k];
    }
    let [p, q, r, s, t, u, v, w] = lanes;
    ((p + t) + (r + v)) + ((q + u) + (s + w))
}

#[test]
fn every_copy_finds_the_same_bits() {
    for seed in 0..300 {
        let mut random = Random::new(seed);
        let (n, count) = (8 * (1 + random.below(6)), random.below(10));
        let mut numbers = |size: usize| -> Vec<f64> { (0..size).map(|_| random.normal()).collect() };
        let (start, s, rows) = (numbers(n), numbers(count), numbers(n * count.max(1)));
        let run = |copy: &dyn Fn(&mut [f64]) -> f64| {
            let mut a = start.clone();
            let value = copy(&mut a);
            a.iter().chain([&value]).map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        let expected = run(&|a| by_hand(a, &s, &rows));
        assert_eq!(run(&|a| everything(false, a, &s, &rows)), expected, "seed {seed}");
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            assert_eq!(run(&|a| everything(true, a, &s, &rows)), expected, "seed {seed}, AVX2");
        }
    }
}
