//! Poses of many sensors: arcs between orientations, and the One-Euro filter (Casiez, Roussel and Vogel, CHI 2012).

use crate::math::{quat_conj, quat_log, quat_mul, Quat, Vec3};
use std::f64::consts::TAU;

/// A shorter arc (rad, of quaternions) is taken as one of this length, at which the weights have their limits.
const SAME_ANGLE: f64 = 1e-8;

/// The orientation on the short arc from a (share 0) through b (share 1), and beyond. NaN in, NaN out.
pub fn along_arc(a: Quat, b: Quat, share: f64) -> Quat {
    let cosine = dot(a, b);
    let sign = 1.0_f64.copysign(cosine);
    // `min` would turn NaN into 1.
    let clipped = if cosine * sign > 1.0 { 1.0 } else { cosine * sign };
    let angle = libm::acos(clipped);
    let angle = if angle < SAME_ANGLE { SAME_ANGLE } else { angle };
    let scale = 1.0 / libm::sin(angle);
    let (of_a, of_b) = (scale * libm::sin(angle - share * angle), scale * sign * libm::sin(share * angle));
    std::array::from_fn(|i| of_a * a[i] + of_b * b[i])
}

fn dot(a: Quat, b: Quat) -> f64 {
    a.iter().zip(&b).map(|(x, y)| x * y).sum()
}

/// Cutoff at rest, Hz; its rise per unit of speed, Hz; cutoff of the speed's own filter, Hz.
#[derive(Clone, Copy, Debug)]
pub struct Cutoffs {
    pub least: f64,
    pub per_speed: f64,
    pub of_speed: f64,
}

/// One vector's filter: its speed, and the time of its last value.
#[derive(Clone, Copy, Debug)]
struct Filter {
    speed: Vec3,
    time: f64,
}

/// A filter before its first value.
const FRESH: Filter = Filter { speed: [0.0; 3], time: f64::NAN };

impl Filter {
    /// The share (0 to 1) of the step `delta` from the filtered value to the new one. 0 if a value is NaN or time has not risen.
    fn share(&mut self, cutoffs: &Cutoffs, time: f64, delta: Vec3) -> f64 {
        let dt = time - self.time;
        if time.is_nan() || delta.iter().any(|d| d.is_nan()) || dt <= 0.0 {
            return 0.0;
        }
        self.time = time;
        if dt.is_nan() {
            return 0.0;
        }
        let follow = low_pass(cutoffs.of_speed, dt);
        for (speed, d) in self.speed.iter_mut().zip(delta) {
            *speed += follow * (d / dt - *speed);
        }
        let size = self.speed.iter().map(|s| s * s).sum::<f64>().sqrt();
        low_pass(cutoffs.least + cutoffs.per_speed * size, dt)
    }
}

/// The share of a step that a low-pass filter of this cutoff (Hz) takes in dt s.
fn low_pass(cutoff: f64, dt: f64) -> f64 {
    let turn = TAU * cutoff * dt;
    turn / (turn + 1.0)
}

/// Filters one pose: its position, and its turns as rotation vectors from the filtered orientation to the new one.
#[derive(Clone, Copy, Debug)]
pub struct SmoothPose {
    position: Vec3,
    orientation: Quat,
    moves: Filter,
    turns: Filter,
}

impl Default for SmoothPose {
    fn default() -> Self {
        Self { position: [f64::NAN; 3], orientation: [f64::NAN; 4], moves: FRESH, turns: FRESH }
    }
}

impl SmoothPose {
    /// The filtered position; NaN if none was sent, and then the state stays.
    pub fn step_position(&mut self, cutoffs: &Cutoffs, time: f64, sent: Vec3) -> Vec3 {
        if time.is_nan() || sent.iter().any(|v| v.is_nan()) {
            return [f64::NAN; 3];
        }
        let fresh = self.position.iter().any(|v| v.is_nan());
        let before = if fresh { sent } else { self.position };
        let delta: Vec3 = std::array::from_fn(|i| sent[i] - before[i]);
        let share = self.moves.share(cutoffs, time, delta);
        self.position = std::array::from_fn(|i| before[i] + share * delta[i]);
        self.position
    }

    /// The filtered orientation; NaN if none was sent, and then the state stays.
    pub fn step_orientation(&mut self, cutoffs: &Cutoffs, time: f64, sent: Quat) -> Quat {
        if time.is_nan() || sent.iter().any(|v| v.is_nan()) {
            return [f64::NAN; 4];
        }
        let fresh = self.orientation.iter().any(|v| v.is_nan());
        let before = if fresh { sent } else { self.orientation };
        let turn = quat_log(quat_mul(sent, quat_conj(before)));
        self.orientation = along_arc(before, sent, self.turns.share(cutoffs, time, turn));
        self.orientation
    }
}
