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

/// What one coordinate may move in one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameBox {
    pub lo: f64,
    pub hi: f64,
    /// The end of the range (or braking before it) is what limits that side, not speed.
    pub lo_is_stop: bool,
    pub hi_is_stop: bool,
}

/// A displacement beyond the box by this is inside (rad, m).
const ROUNDING: f64 = 1e-12;

impl FrameBox {
    pub fn holds(&self, displacement: f64) -> bool {
        self.lo - ROUNDING <= displacement && displacement <= self.hi + ROUNDING
    }
}

/// Displacement box of one coordinate at `q`, whose displacement in the frame before was `before`.
///
/// Acceleration comes first (a machine cannot break it), then velocity, then position and braking distance; a start
/// beyond a limit may only come back, as fast as it may move. Always lo <= hi.
pub fn frame_bounds(q: f64, before: f64, limit: &Limit, dt: f64) -> FrameBox {
    let before = if before.is_finite() { before } else { 0.0 };
    let v = limit.velocity * dt;
    let a = limit.acceleration * dt * dt;
    let (acc_lo, acc_hi) = (before - a, before + a);
    let (brake_up, brake_down) = (braking_displacement(limit.upper - q, a), -braking_displacement(q - limit.lower, a));
    let hi = brake_up.clamp(-v, v).clamp(acc_lo, acc_hi);
    let lo = brake_down.clamp(-v, v).clamp(acc_lo, acc_hi);
    let (lo_is_stop, hi_is_stop) = (brake_down >= lo, brake_up <= hi);
    if lo <= hi {
        FrameBox { lo, hi, lo_is_stop, hi_is_stop }
    } else {
        // Only when the coordinate has no room at all: stand still as nearly as the limits allow.
        let x = 0.0_f64.clamp(acc_lo, acc_hi).clamp(hi.min(lo), hi.max(lo));
        FrameBox { lo: x, hi: x, lo_is_stop, hi_is_stop }
    }
}

/// Part of the frame's box that is left for one iteration, with its step limit. Contains a point of the frame's box always.
pub fn iteration_bounds(frame: &FrameBox, done: f64, step: f64) -> (f64, f64) {
    let (lo, hi) = (frame.lo - done, frame.hi - done);
    if lo > 0.0 {
        (lo, hi.min(step).max(lo))
    } else if hi < 0.0 {
        (lo.max(-step).min(hi), hi)
    } else {
        (lo.max(-step), hi.min(step))
    }
}
