//! Modes of a pair, and its least distance at the end of a frame: the damping of the paper, its integral over a frame, and the
//! separation after contact.

/// Between rows a pair may be nearer by this (m) than at rows, so that a path along the limit can be proven by stretches of finite
/// length.
pub const BETWEEN: f64 = 1e-4;
/// A pair that is too near may come nearer by this (m), as solvers and encoders round: in all if paths are remembered, else (the
/// path of the servos) on each path.
pub const LET_OUT: f64 = 1e-4;

/// Remaining share of an approach (paper, "Preventive observer activation"): 1 at the influence distance, 0 at the margin.
pub fn damping_share(distance: f64, influence: f64, margin: f64) -> f64 {
    ((distance - margin) / (influence - margin)).clamp(0.0, 1.0)
}

/// Least distance at the end of a frame of `dt` s that began at `distance`, for a part that may approach at `speed` (m/s) at the
/// influence distance, and slower towards the margin.
///
/// It is the velocity damper d' >= -speed (d - margin) / (influence - margin) integrated over the frame, so that it holds for frames
/// of any length. Inside the margin the pair separates by the same law.
pub fn damped_floor(distance: f64, influence: f64, margin: f64, speed: f64, dt: f64) -> f64 {
    let room = influence - margin;
    if distance > influence {
        // Free up to the influence distance, which is taken as the start of the whole frame.
        return margin + room * libm::exp(-speed * dt / room);
    }
    margin + (distance - margin) * libm::exp(-speed * dt / room)
}

/// Least distance at the end of a frame for a part in contact, which separates at `speed` (m/s) up to the margin.
pub fn contact_floor(distance: f64, margin: f64, speed: f64, dt: f64) -> f64 {
    (distance + speed * dt).min(margin.max(distance))
}

/// Deeper than this (m) is contact: rounding is not.
pub const CONTACT: f64 = 1e-4;
/// Hysteresis: a pair leaves influence at this multiple of the influence distance, so that its mode does not flicker.
const LEAVING: f64 = 1.05;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub enum Mode {
    #[default]
    Free,
    Preventive,
    Reactive,
}

impl Mode {
    /// The next mode of a pair at this distance, m.
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
