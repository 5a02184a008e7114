//! The last accepted pose of each sensor, how it got there, and since when each of its numbers has not changed.

use crate::math::{Quat, Vec3};

/// Position m, then orientation wxyz.
pub type Pose = [f64; 7];

/// Numbers that differ less (m, parts of a unit quaternion) are the same: an orientation that was composed of others in float32
/// varies by 3e-7. The noise of an inertial sensor exceeds this within one sample, that of optical ones by far.
pub const SAME: f64 = 1e-6;
/// A step that took longer (s) does not show how a sensor moves now.
const CARRIED: f64 = 0.1;
/// A step shorter than this (m) needs no further check: it is neither a jump nor a swap of left and right.
pub const CALM: f64 = 0.06;

/// One sensor. pose: NaN where unknown. at, before: s, of this pose and the one before. step: from that one. since: s, the last
/// change of each number; NaN where it was never seen to change, but for the first position.
#[derive(Clone, Copy, Debug)]
pub struct Last {
    pub pose: Pose,
    pub step: Pose,
    pub at: f64,
    pub before: f64,
    pub since: Pose,
}

const UNKNOWN: Last = Last {
    pose: [f64::NAN; 7],
    step: [0.0; 7],
    at: f64::NEG_INFINITY,
    before: f64::NEG_INFINITY,
    since: [f64::NAN; 7],
};

impl Default for Last {
    fn default() -> Self {
        UNKNOWN
    }
}

pub fn joined(position: Vec3, orientation: Quat) -> Pose {
    std::array::from_fn(|i| if i < 3 { position[i] } else { orientation[i - 3] })
}

impl Last {
    fn step_to(&self, pose: &Pose) -> Pose {
        std::array::from_fn(|i| pose[i] - self.pose[i])
    }

    /// Whether a position is so near to the last one that it needs no second look; not where there is no last one.
    pub fn is_calm(&self, position: Vec3) -> bool {
        let step: Vec3 = std::array::from_fn(|i| position[i] - self.pose[i]);
        step.iter().map(|d| d * d).sum::<f64>() <= CALM * CALM
    }

    /// The next pose: in order and near, the first, after a jump, or on a clock that was set back.
    pub fn put(&mut self, time: f64, pose: Pose) {
        let step = self.step_to(&pose);
        let first = step[0].is_nan();
        for i in 0..7 {
            if step[i].abs() > SAME || (first && i < 3) {
                self.since[i] = time;
            }
        }
        let carried = (time - self.at).abs() <= CARRIED;
        self.step = if carried { step } else { [0.0; 7] };
        (self.pose, self.before, self.at) = (pose, self.at, time);
    }

    /// It comes without an orientation now.
    pub fn forget_turn(&mut self) {
        self.since[3..].fill(f64::NAN);
    }

    /// How long it has repeated its value, s: its orientation where that was ever seen to change, for a lost tracker of a chain
    /// keeps its orientation while its position is carried along; else its position.
    pub fn still_for(&self) -> f64 {
        let (place, turn) = self.changed();
        self.at - if turn.is_nan() { place } else { turn }
    }

    /// The last change of position and of orientation, s: of any number that ever changed; NaN where none did.
    pub fn changed(&self) -> (f64, f64) {
        let latest = |since: &[f64]| since.iter().copied().fold(f64::NAN, f64::max);
        (latest(&self.since[..3]), latest(&self.since[3..]))
    }
}
