//! Where an obstacle is, and how it moves.

use crate::math::*;

/// Where an obstacle is at the start of a frame, and how it moves.
#[derive(Clone, Copy, Debug)]
pub struct ObstaclePose {
    pub position: Vec3,
    pub quat: Quat,
    pub linear: Vec3,
    /// World frame, rad/s.
    pub angular: Vec3,
}

impl ObstaclePose {
    pub fn moves(&self) -> bool {
        self.linear != [0.0; 3] || self.angular != [0.0; 3]
    }

    /// The same, `time` s later.
    pub fn after(&self, time: f64) -> Self {
        if !self.moves() {
            return *self;
        }
        let position = add(self.position, scale(self.linear, time));
        Self { position, quat: quat_unit(quat_mul(quat_exp(scale(self.angular, time)), self.quat)), ..*self }
    }
}
