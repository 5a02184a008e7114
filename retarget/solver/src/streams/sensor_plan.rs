//! Sensor plan: the sensors of a performer from the poses of a sender.

use crate::math::{mat_vec, quat_mul, quat_to_mat, sub, Quat, Vec3};

/// A pose that is sent in parts (position and rotation in separate messages) is joined from parts this near in time (s).
const PARTNER: f64 = 0.1;

/// Source of a sensor's pose. point, segment: columns of position and orientation in the frame, None if it has none. turn: factor of its
/// orientation. offset: from the joint to the point that is sent, m, in the axes of that pose.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    pub point: Option<usize>,
    pub segment: Option<usize>,
    pub turn: Quat,
    pub offset: Option<Vec3>,
}

impl Column {
    /// Position, m; NaN without one.
    pub fn place(&self, position: &[Vec3], orientation: &[Quat]) -> Vec3 {
        match (self.point, self.offset) {
            (None, _) => [f64::NAN; 3],
            (Some(point), None) => position[point],
            (Some(point), Some(offset)) => sub(position[point], mat_vec(&quat_to_mat(orientation[point]), offset)),
        }
    }

    /// Orientation wxyz; NaN without one.
    pub fn turn(&self, orientation: &[Quat]) -> Quat {
        self.segment.map_or([f64::NAN; 4], |segment| quat_mul(orientation[segment], self.turn))
    }
}

/// The last pose of one sensor, part by part, each with its time, s.
#[derive(Clone, Copy, Debug)]
pub struct Parts {
    position: (f64, Vec3),
    orientation: (f64, Quat),
}

impl Default for Parts {
    fn default() -> Self {
        Self { position: (f64::NEG_INFINITY, [f64::NAN; 3]), orientation: (f64::NEG_INFINITY, [f64::NAN; 4]) }
    }
}

impl Parts {
    /// The pose, in which a missing part is the one that was sent just before.
    pub fn complete(&mut self, time: f64, position: Vec3, orientation: Quat) -> (Vec3, Quat) {
        (part(&mut self.position, time, position), part(&mut self.orientation, time, orientation))
    }
}

fn part<const N: usize>(kept: &mut (f64, [f64; N]), time: f64, sent: [f64; N]) -> [f64; N] {
    if sent[0].is_finite() {
        *kept = (time, sent);
        sent
    } else if time - kept.0 <= PARTNER {
        kept.1
    } else {
        sent
    }
}
