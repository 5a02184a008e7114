//! Position, velocity, acceleration and braking-distance limits of one frame, as a box on its displacement.

/// Limits of one velocity coordinate. Infinite where there is none.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    pub lower: f64,
    pub upper: f64,
    pub velocity: f64,
    pub acceleration: f64,
}

impl Limit {
    pub const NONE: Self =
        Self { lower: f64::NEG_INFINITY, upper: f64::INFINITY, velocity: f64::INFINITY, acceleration: f64::INFINITY };
}

/// Largest displacement x of this frame such that x, x - a, x - 2a, ... (down to zero) stays within `gap`,
/// where `a` is the change of displacement per frame that the acceleration limit allows.
fn braking_displacement(gap: f64, a: f64) -> f64 {
    if gap <= 0.0 || !gap.is_finite() {
        return gap;
    }
    if !a.is_finite() || a <= 0.0 {
        return gap;
    }
    let n = ((((1.0 + 8.0 * gap / a).sqrt() - 1.0) * 0.5).floor()).max(0.0);
    (gap + a * n * (n + 1.0) * 0.5) / (n + 1.0)
}

/// Displacement box (lo, hi) of one coordinate at `q`, whose displacement in the frame before was `before`.
///
/// Acceleration comes first (a machine cannot break it), then velocity, then position and braking distance; a start
/// beyond a limit may only come back, as fast as it may move. Always lo <= hi.
pub fn frame_bounds(q: f64, before: f64, limit: &Limit, dt: f64) -> (f64, f64) {
    let v = limit.velocity * dt;
    let a = limit.acceleration * dt * dt;
    let (acc_lo, acc_hi) = (before - a, before + a);
    let up = braking_displacement(limit.upper - q, a).clamp(-v, v);
    let down = -braking_displacement(q - limit.lower, a).clamp(-v, v);
    let hi = up.clamp(acc_lo, acc_hi);
    let lo = down.clamp(acc_lo, acc_hi);
    if lo <= hi {
        (lo, hi)
    } else {
        // Only when the coordinate has no room at all: stand still as nearly as the limits allow.
        let x = 0.0_f64.clamp(acc_lo, acc_hi).clamp(hi.min(lo), hi.max(lo));
        (x, x)
    }
}

/// Part of the frame's box that is left for one iteration, with its step limit. Contains a point of the frame's box always.
pub fn iteration_bounds(frame: (f64, f64), done: f64, step: f64) -> (f64, f64) {
    let (lo, hi) = (frame.0 - done, frame.1 - done);
    if lo > 0.0 {
        (lo, hi.min(step).max(lo))
    } else if hi < 0.0 {
        (lo.max(-step).min(hi), hi)
    } else {
        (lo.max(-step), hi.min(step))
    }
}
