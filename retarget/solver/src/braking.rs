//! What a gate lets pass in a tick, and how joints that each brake by themselves come to rest.

use crate::bounds::{frame_bounds, Limit};

pub struct Braking {
    limits: Vec<Limit>,
    dt: f64,
    /// Largest change of displacement between ticks (rad or m).
    change: Vec<f64>,
    /// Postures of a path: the present one, the goal, and those of the ticks that the fastest joint needs to stand.
    pub rows: usize,
}

impl Braking {
    /// Limits are finite, and those of speed and acceleration positive.
    pub fn new(limits: Vec<Limit>, dt: f64) -> Self {
        let change: Vec<f64> = limits.iter().map(|l| l.acceleration * (dt * dt)).collect();
        let ticks = limits.iter().zip(&change).map(|(l, change)| l.velocity * dt / change).fold(0.0, f64::max);
        Self { limits, dt, change, rows: 3 + ticks.ceil() as usize }
    }

    pub fn joints(&self) -> usize {
        self.limits.len()
    }

    /// The next displacement of joint i under full deceleration.
    pub fn braked(&self, i: usize, displacement: f64) -> f64 {
        (displacement.abs() - self.change[i]).max(0.0).copysign(displacement)
    }

    /// Displacements of joint i that leave it a way to brake within its range. To go on braking is always among them, beyond a limit too.
    pub fn bounds(&self, i: usize, position: f64, displacement: f64) -> (f64, f64) {
        let braked = self.braked(i, displacement);
        let bounds = frame_bounds(position, displacement, &self.limits[i], self.dt);
        (bounds.lo.min(braked), bounds.hi.max(braked))
    }

    /// Displacement of joint i to a goal that misses its bounds by no more than `tolerance`.
    pub fn admitted(&self, i: usize, position: f64, displacement: f64, goal: f64, tolerance: f64) -> Option<f64> {
        let (lo, hi) = self.bounds(i, position, displacement);
        let asked = goal - position;
        (lo - asked <= tolerance && asked - hi <= tolerance).then(|| asked.max(lo).min(hi))
    }

    /// Postures (rows, n) from `position` through `displacement` to rest; the last may repeat.
    pub fn path(&self, position: &[f64], displacement: &[f64]) -> Vec<f64> {
        let n = self.joints();
        let mut path = Vec::with_capacity(self.rows * n);
        path.extend_from_slice(position);
        let mut gone = vec![0.0; n];
        for row in 0..self.rows - 1 {
            for i in 0..n {
                let slower = (displacement[i].abs() - row as f64 * self.change[i]).max(0.0);
                gone[i] += slower.copysign(displacement[i]);
                path.push(position[i] + gone[i]);
            }
        }
        path
    }
}
