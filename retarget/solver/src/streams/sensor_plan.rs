//! Sensor plan: from the poses of a sender to the sensors of a performer.

use crate::math::{quat_mul, sub, Quat, Vec3};

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
            (Some(point), Some(offset)) => sub(position[point], turned(orientation[point], offset)),
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

/// A vector turned by a unit quaternion: v + 2 w (u x v) + 2 u x (u x v).
fn turned(q: Quat, v: Vec3) -> Vec3 {
    let [w, x, y, z] = q;
    let t = [2.0 * (y * v[2] - z * v[1]), 2.0 * (z * v[0] - x * v[2]), 2.0 * (x * v[1] - y * v[0])];
    [
        v[0] + w * t[0] + y * t[2] - z * t[1],
        v[1] + w * t[1] + z * t[0] - x * t[2],
        v[2] + w * t[2] + x * t[1] - y * t[0],
    ]
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
