//! Pose check, each pose by itself: finite, in the room, a rotation, and marked as tracked by the sender.

use crate::math::{Quat, Vec3};

/// The verdict on one pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Verdict {
    Valid = 0,
    Untracked = 1,
    NotFinite = 2,
    NotARotation = 3,
    OutOfRange = 4,
}

/// reach: m, horizontally from the origin along each axis; low, high: m, of the height; norm: how far that of a quaternion may
/// be from 1.
#[derive(Clone, Copy, Debug)]
pub struct Room {
    pub reach: f64,
    pub low: f64,
    pub high: f64,
    pub norm: f64,
}

impl Room {
    /// Judge a pose. A position is needed; an orientation may be missing: NaN throughout.
    pub fn judge(&self, position: Vec3, orientation: Quat, tracked: bool) -> Verdict {
        let missing = orientation.iter().all(|x| x.is_nan());
        let finite = position.iter().all(|x| x.is_finite()) && (missing || orientation.iter().all(|x| x.is_finite()));
        if !tracked {
            return Verdict::Untracked;
        }
        if !finite {
            return Verdict::NotFinite;
        }
        let norm = orientation.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !missing && !((norm - 1.0).abs() <= self.norm) {
            return Verdict::NotARotation;
        }
        let [x, y, z] = position;
        if x.abs() <= self.reach && y.abs() <= self.reach && (self.low..=self.high).contains(&z) {
            Verdict::Valid
        } else {
            Verdict::OutOfRange
        }
    }
}
