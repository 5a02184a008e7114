//! Sensor plan: from the poses of a sender to the sensors of a performer.

use crate::math::{mat_vec, quat_mul, quat_to_mat, sub, Quat, Vec3};

/// A pose that is sent in parts (position here, rotation there) is put together from parts this near in time (s).
const PARTNER: f64 = 0.1;

/// Where a sensor's pose is found. point, segment: columns of the frame, None where it has none. turn: what its orientation is
/// multiplied by. offset: from the joint to the point that is sent, m, in the axes of that pose.
#[derive(Clone, Copy, Debug)]
pub struct Column {
    pub point: Option<usize>,
    pub segment: Option<usize>,
    pub turn: Quat,
    pub offset: Option<Vec3>,
}

impl Column {
    /// NaN where there is none.
    pub fn place(&self, position: &[Vec3], orientation: &[Quat]) -> Vec3 {
        match (self.point, self.offset) {
            (None, _) => [f64::NAN; 3],
            (Some(point), None) => position[point],
            (Some(point), Some(offset)) => sub(position[point], mat_vec(&quat_to_mat(orientation[point]), offset)),
        }
    }

    /// NaN where there is none.
    pub fn turn(&self, orientation: &[Quat]) -> Quat {
        self.segment.map_or([f64::NAN; 4], |segment| quat_mul(orientation[segment], self.turn))
    }

    /// Whether the sender marks it as tracked.
    pub fn is_tracked(&self, tracked: &[bool]) -> bool {
        self.point.or(self.segment).is_some_and(|column| tracked[column])
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
    /// The pose; a part that was not sent is that which was sent just before.
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
