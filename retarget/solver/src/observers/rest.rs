//! Where the body would come to rest, were it braked after a frame like the last one, all joints in proportion: there too pairs keep
//! their margin, by a second row. What is nearest now need not be what is nearest then: a thigh that swings up meets the trunk with its
//! far end.

use super::set::ObserverSet;
use crate::body::Body;
use crate::braking::Limit;
use crate::geometry::Solid;
use crate::kinematics::Pose;

/// The posture in which the body would come to rest if it braked after this frame.
pub struct Rest {
    pub pose: Pose,
    pub solids: Vec<Solid>,
    pub q: Vec<f64>,
    /// Displacement until rest, (T + dt) / 2 v for a body that needs T s to stop (nv).
    pub way: Vec<f64>,
    /// What remains of a frame like the last one, dt v less what this one has moved so far (nv).
    pub left: Vec<f64>,
    /// Most that this frame can add to `way`, (T + dt) / 2 dt a (nv).
    pub change: Vec<f64>,
    /// Displacement in a frame for one until rest, 2 dt / (T + dt); 0: the body rests.
    pub share: f64,
}

impl Rest {
    pub fn new(body: &Body, set: &ObserverSet) -> Self {
        let still = || vec![0.0; body.nv];
        let (pose, solids, q) = (body.new_pose(), set.new_solids(), body.rest());
        Self { pose, solids, q, way: still(), left: still(), change: still(), share: 0.0 }
    }

    /// A frame of `dt` s begins in posture q (nq), of a body whose coordinates (nv) go by `velocity` and that needs `stopping` s to come to
    /// rest.
    pub fn foresee(
        &mut self,
        (body, set): (&Body, &ObserverSet),
        q: &[f64],
        (velocity, limits): (&[f64], &[Limit]),
        dt: f64,
        stopping: f64,
    ) {
        self.share = 0.0;
        if stopping == 0.0 {
            return;
        }
        self.share = 2.0 * dt / (stopping + dt);
        for i in 0..velocity.len() {
            self.way[i] = 0.5 * (stopping + dt) * velocity[i]; // all joints brake in proportion
            self.left[i] = dt * velocity[i];
            self.change[i] = 0.5 * (stopping + dt) * dt * limits[i].acceleration;
        }
        self.q.copy_from_slice(q);
        body.integrate(&mut self.q, &self.way);
        body.forward(&self.q, &mut self.pose);
        set.place(&self.pose, &mut self.solids);
    }
}
