//! One model of braking for solver, gate and stop: the box on the displacement of a coordinate in one frame (position, velocity,
//! acceleration and braking-distance limits), and the path on which joints come to rest.

/// Limits of one velocity coordinate; infinite ones do not limit.
#[derive(Clone, Copy, Debug)]
pub struct Limit {
    pub lower: f64,
    pub upper: f64,
    pub velocity: f64,
    pub acceleration: f64,
}

/// Largest displacement x of this frame such that x, x - a, x - 2a, ... (down to zero) stays within `gap`,
/// where `a` is the change of displacement per frame that the acceleration limit allows.
pub fn braking_displacement(gap: f64, a: f64) -> f64 {
    if gap <= 0.0 || !gap.is_finite() || !a.is_finite() || a <= 0.0 {
        return gap;
    }
    let n = ((((1.0 + 8.0 * gap / a).sqrt() - 1.0) * 0.5).floor()).max(0.0);
    (gap + a * n * (n + 1.0) * 0.5) / (n + 1.0)
}

/// Bounds of the displacement of one coordinate in one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct FrameBox {
    pub lo: f64,
    pub hi: f64,
    /// True if the end of the range, or braking before it, limits that side, not speed.
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
/// Acceleration comes first (a machine cannot break it), then velocity, then position and braking distance. From beyond a
/// limit a coordinate may only come back, as fast as it may move. Always lo <= hi. A share `speed` (0, 1] scales the limit
/// of velocity, and its square that of acceleration; to brake, the whole acceleration may always be used.
pub fn frame_bounds(q: f64, before: f64, limit: &Limit, speed: f64, dt: f64) -> FrameBox {
    let before = if before.is_finite() { before } else { 0.0 };
    let v = speed * limit.velocity * dt;
    let a = limit.acceleration * dt * dt;
    let gain = speed * speed * a;
    let (acc_lo, acc_hi) = ((before - gain).min(0.0).max(before - a), (before + gain).max(0.0).min(before + a));
    let (brake_up, brake_down) = (braking_displacement(limit.upper - q, a), -braking_displacement(q - limit.lower, a));
    let hi = brake_up.clamp(-v, v).clamp(acc_lo, acc_hi);
    let lo = brake_down.clamp(-v, v).clamp(acc_lo, acc_hi);
    let (lo_is_stop, hi_is_stop) = (brake_down >= lo, brake_up <= hi);
    if lo <= hi {
        FrameBox { lo, hi, lo_is_stop, hi_is_stop }
    } else {
        // The coordinate has no room at all: stand still as nearly as the limits allow.
        let x = 0.0_f64.clamp(acc_lo, acc_hi).clamp(hi.min(lo), hi.max(lo));
        FrameBox { lo: x, hi: x, lo_is_stop, hi_is_stop }
    }
}

/// Deceleration (m/s^2) with which the centre of mass of a body that stands on its soles can surely be stopped.
pub const MASS_BRAKING: f64 = 1.0;

/// The motion of a body, and the limits of its joints.
pub struct Motion<'a> {
    /// Velocity of every coordinate, per second.
    pub velocity: &'a [f64],
    pub limits: &'a [Limit],
    /// Postures (k, nq) in which a planned stop would end, and its time, s. Without it, joints are taken to brake in proportion.
    pub stop: Option<(&'a [f64], f64)>,
}

/// Time (s) in which a body comes to rest, all coordinates in proportion, the slowest at its full deceleration. 0 for a body at rest, and
/// for one that stops at once.
pub fn stopping_time(velocity: &[f64], limits: &[Limit]) -> f64 {
    velocity.iter().zip(limits).map(|(v, limit)| v.abs() / limit.acceleration).fold(0.0, f64::max)
}

/// The part of the frame's box that is left for one iteration, within its step limit. It always contains a point of the frame's box.
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

/// Most rows of a stop, for joints that are far too fast.
const MOST_ROWS: usize = 1000;

/// Displacements that a gate accepts in a tick, and the path on which braking joints come to rest together.
pub struct Braking {
    limits: Vec<Limit>,
    dt: f64,
    /// Largest change of displacement between ticks (rad or m).
    change: Vec<f64>,
    /// Ticks that the slowest joint needs from its greatest speed, and one for rounding.
    longest: usize,
}

impl Braking {
    /// Limits are finite, and those of speed and acceleration positive.
    pub fn new(limits: Vec<Limit>, dt: f64) -> Self {
        let change: Vec<f64> = limits.iter().map(|l| l.acceleration * (dt * dt)).collect();
        let ticks = limits.iter().zip(&change).map(|(l, change)| l.velocity * dt / change).fold(0.0, f64::max);
        Self { limits, dt, change, longest: 1 + ticks.ceil() as usize }
    }

    pub fn joints(&self) -> usize {
        self.limits.len()
    }

    /// Displacements of joint i from which it can brake within its range. To go on braking is always among them, beyond a limit too.
    pub fn bounds(&self, i: usize, position: f64, displacement: f64) -> (f64, f64) {
        let braked = (displacement.abs() - self.change[i]).max(0.0).copysign(displacement);
        let bounds = frame_bounds(position, displacement, &self.limits[i], 1.0, self.dt);
        (bounds.lo.min(braked), bounds.hi.max(braked))
    }

    /// Ticks that the slowest joint needs to come to rest at its full deceleration, 1 at least.
    pub fn ticks(&self, displacement: &[f64]) -> f64 {
        let slowest = displacement.iter().zip(&self.change).map(|(d, change)| d.abs() / change).fold(1.0, f64::max);
        slowest.min(self.longest as f64) // one that is too fast brakes by itself
    }

    /// The next displacement of joints that brake in proportion, so that they keep their direction and come to rest together. A joint
    /// that would leave its range brakes earlier.
    pub fn brake(&self, position: &[f64], displacement: &mut [f64]) {
        let left = 1.0 - 1.0 / self.ticks(displacement);
        for (i, d) in displacement.iter_mut().enumerate() {
            let (lo, hi) = self.bounds(i, position[i], *d);
            *d = (left * *d).max(lo).min(hi);
        }
    }

    /// Displacement of joint i to a goal that misses its bounds by no more than `tolerance`.
    pub fn accepted(&self, i: usize, position: f64, displacement: f64, goal: f64, tolerance: f64) -> Option<f64> {
        let (lo, hi) = self.bounds(i, position, displacement);
        let requested = goal - position;
        (lo - requested <= tolerance && requested - hi <= tolerance).then(|| requested.max(lo).min(hi))
    }

    /// Postures (rows, n) tick by tick to rest, of joints that got to `position` by `displacement`; empty if they may stop at once.
    pub fn stop(&self, position: &[f64], displacement: &[f64]) -> Vec<f64> {
        let (mut path, mut at, mut moved) = (vec![], position.to_vec(), displacement.to_vec());
        for _ in 0..MOST_ROWS {
            self.brake(&at, &mut moved);
            if moved.iter().all(|d| *d == 0.0) {
                break;
            }
            at.iter_mut().zip(&moved).for_each(|(at, moved)| *at += moved);
            path.extend_from_slice(&at);
        }
        path
    }

    /// True if joints that got to `position` by `displacement` keep every limit on `path` (rows, n), and may stop at its end at once.
    pub fn keeps(&self, position: &[f64], displacement: &[f64], path: &[f64], tolerance: f64) -> bool {
        let (mut at, mut moved) = (position.to_vec(), displacement.to_vec());
        for row in path.chunks_exact(self.joints()) {
            for i in 0..row.len() {
                match self.accepted(i, at[i], moved[i], row[i], tolerance) {
                    Some(displacement) => moved[i] = displacement,
                    None => return false,
                }
                at[i] = row[i];
            }
        }
        moved.iter().zip(&self.change).all(|(moved, change)| moved.abs() <= change + tolerance)
    }
}
