//! The posture in which the body would come to rest if it braked after a frame like the last one, by its planned stop or with all joints
//! in proportion, and the obstacles at that time. A second row keeps the margin of pairs there, as other points may be nearest: a thigh
//! that swings up meets the trunk with its far end.

use super::set::{place_obstacles, ObserverSet, ObstaclePose};
use crate::body::Body;
use crate::braking::{stopping_time, Motion};
use crate::geometry::Solid;
use crate::kinematics::Pose;

/// Body and obstacles in a posture of rest.
pub struct Foreseen {
    pub pose: Pose,
    pub solids: Vec<Solid>,
    pub fixtures: Vec<Solid>,
}

impl Foreseen {
    fn new(body: &Body, set: &ObserverSet) -> Self {
        Self { pose: body.new_pose(), solids: set.new_solids(), fixtures: set.new_fixtures() }
    }
}

/// The posture in which the body would come to rest if it braked after this frame.
pub struct Rest {
    /// The first `count` are in use: more than one if locked coordinates go on through several postures.
    pub foreseen: Vec<Foreseen>,
    pub count: usize,
    q: Vec<f64>,
    /// Time from the start of the frame until rest, s: T + dt for a body that needs T s to stop after it. 0 if it rests, stops at once
    /// or cannot brake, and nothing is foreseen.
    pub time: f64,
    /// Displacement in a frame for one until rest, 2 dt / (T + dt).
    pub share: f64,
    /// Displacement until rest, v (T + dt) / 2, and no farther than to the end of the range (nv).
    pub displacement: Vec<f64>,
    /// Displacement of a frame while braking, share * displacement, minus the motion of this frame so far (nv).
    pub left: Vec<f64>,
    /// Most that this frame can add to `displacement`, a dt (T + dt) / 2 (nv).
    pub change: Vec<f64>,
}

impl Rest {
    pub fn new(body: &Body, set: &ObserverSet) -> Self {
        let still = || vec![0.0; body.nv];
        let (q, displacement, left, change) = (body.rest(), still(), still(), still());
        Self {
            foreseen: vec![Foreseen::new(body, set)],
            count: 1,
            q,
            time: 0.0,
            share: 0.0,
            displacement,
            left,
            change,
        }
    }

    /// Foresee the rest of a body whose frame of `dt` s begins in posture q (nq).
    pub fn foresee(
        &mut self,
        (body, set): (&Body, &ObserverSet),
        obstacles: &[ObstaclePose],
        q: &[f64],
        motion: &Motion,
        dt: f64,
    ) {
        let (stopping, limits) =
            (motion.stop.map_or_else(|| stopping_time(motion.velocity, motion.limits), |stop| stop.1), motion.limits);
        self.time = 0.0;
        if stopping == 0.0 || !stopping.is_finite() {
            return;
        }
        self.time = stopping + 2.0 * dt;
        self.share = 2.0 * dt / self.time;
        for (i, (v, limit)) in motion.velocity.iter().zip(limits).enumerate() {
            // A joint that could stop at once comes to rest with the others, and speeds up by no more than its speed.
            let change = if limit.acceleration.is_finite() { dt * limit.acceleration } else { v.abs() };
            self.displacement[i] = 0.5 * self.time * v;
            self.change[i] = 0.5 * self.time * change;
        }
        let nq = q.len();
        self.count = motion.stop.map_or(1, |(postures, _)| postures.len() / nq);
        while self.foreseen.len() < self.count {
            self.foreseen.push(Foreseen::new(body, set));
        }
        for k in (0..self.count).rev() {
            if let Some((postures, _)) = motion.stop {
                body.difference(q, &postures[k * nq..(k + 1) * nq], &mut self.displacement);
                self.displacement.iter_mut().zip(motion.velocity).for_each(|(gone, v)| *gone += dt * v);
            }
            // Before the end of its range a joint brakes earlier.
            for joint in body.joints.iter().filter(|joint| joint.kind.size() == (1, 1)) {
                let (limit, at) = (&limits[joint.v_address], q[joint.q_address]);
                let displacement = &mut self.displacement[joint.v_address];
                *displacement = displacement.max((limit.lower - at).min(0.0)).min((limit.upper - at).max(0.0));
            }
            self.q.copy_from_slice(q);
            body.integrate(&mut self.q, &self.displacement);
            let foreseen = &mut self.foreseen[k];
            body.forward(&self.q, &mut foreseen.pose);
            set.place(&foreseen.pose, &mut foreseen.solids);
            place_obstacles(obstacles, self.time, &mut foreseen.fixtures);
        }
        for (left, displacement) in self.left.iter_mut().zip(&self.displacement) {
            *left = self.share * displacement;
        }
    }
}
