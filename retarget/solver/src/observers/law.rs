//! What a pair does at a distance, and how near it may come: the damping of the paper, its integral over a frame, the way out of
//! contact; what the gate rounds.

/// Between rows a pair may be nearer by this (m) than at rows: what is sent keeps so much more than what is promised, so that a
/// path along the limit can still be proven by stretches of finite length.
pub const BETWEEN: f64 = 1e-4;
/// A pair that is nearer than it ought to be may come nearer by this (m) in all, not per path, where paths are remembered, and by
/// so much per path where they are not (that of the servos): solvers and encoders round.
pub const LET_OUT: f64 = 1e-4;

/// Share of an approach that stays (paper, "Preventive observer activation"): 1 where influence begins, 0 at the margin.
pub fn damping_share(distance: f64, influence: f64, margin: f64) -> f64 {
    ((distance - margin) / (influence - margin)).clamp(0.0, 1.0)
}

/// Least distance at the end of a frame of `dt` s that began at `distance`, for a part that may approach at `speed` (m/s) where
/// influence begins and ever slower towards the margin.
///
/// It is the velocity damper d' >= -speed (d - margin) / (influence - margin) integrated over the frame, so that no frame is too
/// long for it. Inside the margin it asks to get out at the same law.
pub fn damped_floor(distance: f64, influence: f64, margin: f64, speed: f64, dt: f64) -> f64 {
    let room = influence - margin;
    if distance > influence {
        // Free until influence begins, and for the rest of the frame as from there.
        return margin + room * libm::exp(-speed * dt / room);
    }
    margin + (distance - margin) * libm::exp(-speed * dt / room)
}

/// Least distance at the end of a frame for a part that touches: out at `speed` (m/s), up to the margin and no farther.
pub fn way_out(distance: f64, margin: f64, speed: f64, dt: f64) -> f64 {
    (distance + speed * dt).min(margin.max(distance))
}

/// Deeper than this (m) is contact: rounding is not.
pub const CONTACT: f64 = 1e-4;
/// A pair leaves influence a little farther out than it came in, so that rest at the edge is no coming and going.
const LEAVING: f64 = 1.05;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub enum Mode {
    #[default]
    Free,
    Preventive,
    Reactive,
}

impl Mode {
    /// What a pair does next at this distance.
    pub fn next(self, distance: f64, influence: f64) -> Self {
        let touches = distance < if self == Self::Reactive { -0.5 * CONTACT } else { -CONTACT };
        let is_near = distance < if self == Self::Free { influence } else { LEAVING * influence };
        match (touches, is_near) {
            (true, _) => Self::Reactive,
            (_, true) => Self::Preventive,
            _ => Self::Free,
        }
    }
}
