//! Random numbers from a seed: SplitMix64 (Steele, Lea, Flood, OOPSLA 2014).

use crate::math::{norm, quat_unit, scale, Quat, Vec3};

pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// From low up to high.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// 0 to count - 1.
    pub fn below(&mut self, count: usize) -> usize {
        (self.bits() % count as u64) as usize
    }

    pub fn chance(&mut self, share: f64) -> bool {
        self.between(0.0, 1.0) < share
    }

    /// Nearly normal, variance 1: the sum of twelve (Irwin, Hall).
    pub fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.between(-0.5, 0.5)).sum()
    }

    pub fn unit(&mut self) -> Vec3 {
        loop {
            let v: Vec3 = std::array::from_fn(|_| self.between(-1.0, 1.0));
            if (0.1..1.0).contains(&norm(v)) {
                return scale(v, 1.0 / norm(v));
            }
        }
    }

    pub fn turn(&mut self) -> Quat {
        quat_unit(std::array::from_fn(|_| self.normal()))
    }
}
