//! Poses of observers and obstacles at one time of a path, and distances of pairs.
//!
//! A robot on its feet turns and shifts with its joints, because the planted foot stays. Distances depend on relative motion only, so the
//! root stays in place, and the obstacles are placed relative to the foot.

use super::set::{place_obstacles, ObserverSet, ObstaclePose, Other};
use super::timed_path::TimedPath;
use crate::body::Body;
use crate::geometry::{extreme, gap_at_least, nearest, Scratch, Shape, Solid};
use crate::kinematics::Pose;
use crate::math::*;
use std::sync::Arc;

pub struct PathScene {
    pub body: Arc<Body>,
    pub set: Arc<ObserverSet>,
    /// Index in a posture of each value of a path.
    pub columns: Vec<usize>,
    /// Link and point of every sole that may be planted; none for a robot whose root stays.
    pub soles: Vec<(usize, Vec3)>,
    /// Index of the planted sole, the lower one.
    pub planted: usize,
    pub obstacles: Vec<ObstaclePose>,
    /// Seconds between rows.
    pub dt: f64,
    /// Postures computed since construction.
    pub looks: u64,
    foot: (Vec3, Quat),
    q: Vec<f64>,
    pose: Pose,
    solids: Vec<Solid>,
    fixtures: Vec<Solid>,
    /// The last link that both sides of a pair of observers hang on; None (the ground) for a pair with an obstacle.
    bases: Vec<Option<usize>>,
    scratch: Scratch,
}

impl PathScene {
    pub fn new(body: Arc<Body>, set: Arc<ObserverSet>, columns: Vec<usize>, soles: Vec<(usize, Vec3)>) -> Self {
        Self {
            planted: 0,
            obstacles: vec![ObstaclePose::REST; set.obstacles.len()],
            dt: 0.0,
            looks: 0,
            foot: ([0.0; 3], [1.0, 0.0, 0.0, 0.0]),
            q: body.rest(),
            pose: body.new_pose(),
            solids: set.new_solids(),
            fixtures: set.new_fixtures(),
            bases: set.pairs.iter().map(|p| base_of(&body, &set, p.observer, p.other)).collect(),
            scratch: Scratch::default(),
            body,
            set,
            columns,
            soles,
        }
    }

    /// Stand in posture `q`, whose lower sole is planted.
    pub fn stand(&mut self, q: &[f64]) {
        self.q.copy_from_slice(q);
        if self.soles.is_empty() {
            return;
        }
        self.body.forward(&self.q, &mut self.pose);
        let height = |sole: &(usize, Vec3)| self.body.point(&self.pose, sole.0, sole.1)[2];
        self.planted = 0;
        for k in 1..self.soles.len() {
            if height(&self.soles[k]) < height(&self.soles[self.planted]) {
                self.planted = k;
            }
        }
        let link = self.soles[self.planted].0;
        self.foot = (self.pose.position[link], self.pose.quat[link]);
    }

    /// Place everything at a time in rows.
    pub fn place(&mut self, path: &TimedPath, time: f64) {
        path.at(time, &self.columns, &mut self.q);
        self.body.forward(&self.q, &mut self.pose);
        self.set.place(&self.pose, &mut self.solids);
        self.looks += 1;
        place_obstacles(&self.obstacles, time * self.dt, &mut self.fixtures);
        let Some(&(link, _)) = self.soles.get(self.planted) else { return };
        let turn = mat_mul(&self.pose.rotation[link], &quat_to_mat(quat_conj(self.foot.1)));
        for solid in &mut self.fixtures {
            solid.position = add(self.pose.position[link], mat_vec(&turn, sub(solid.position, self.foot.0)));
            solid.rotation = mat_mul(&turn, &solid.rotation);
        }
    }

    /// A lower bound of the distance of a pair, m.
    pub fn gap(&self, pair: usize) -> f64 {
        let (a, b) = self.both(pair);
        gap_at_least(a, b)
    }

    /// Signed distance of a pair, m, and the direction that separates it, in the pair's base.
    pub fn nearest(&mut self, pair: usize) -> (f64, Vec3) {
        let (a, b) = self.set.sides(pair, &self.solids, &self.fixtures);
        let found = nearest(a, b, &mut self.scratch);
        (found.distance, mat_t_vec(&self.pose.rotation[self.base(pair)], found.normal))
    }

    /// Separation of a pair along a direction in its base, m: never more than its distance.
    pub fn separation(&self, pair: usize, direction: Vec3) -> f64 {
        let (a, b) = self.both(pair);
        if b.shape == Shape::HalfSpace {
            return gap_at_least(a, b); // the distance itself
        }
        let n = mat_vec(&self.pose.rotation[self.base(pair)], direction);
        let length = norm(n);
        if length < 0.5 {
            return f64::NEG_INFINITY; // no direction is known so far
        }
        let n = scale(n, 1.0 / length);
        dot(n, sub(a.position, b.position)) - extreme(a, scale(n, -1.0)).0 - extreme(b, n).0
    }

    /// The link that both sides of a pair hang on, in which its directions are fixed.
    fn base(&self, pair: usize) -> usize {
        match self.bases[pair] {
            Some(link) => link,
            None => self.soles.get(self.planted).map_or(0, |sole| sole.0),
        }
    }

    /// The obstacle of a pair, if it has one that moves.
    pub fn moving(&self, pair: usize) -> Option<&ObstaclePose> {
        match self.set.pairs[pair].other {
            Other::Obstacle(o) => Some(&self.obstacles[o]).filter(|o| o.moves()),
            Other::Observer(_) => None,
        }
    }

    /// Greatest speed (m/s) of the obstacle of a pair where it may be nearest, for an observer that moves by at most `motion` m on
    /// a path of `time` s.
    pub fn obstacle_speed(&self, pair: usize, motion: f64, time: f64) -> f64 {
        let Some(obstacle) = self.moving(pair) else { return 0.0 };
        let (a, b) = self.both(pair);
        // The nearest point of a half-space is right below the observer.
        let below = norm(sub(a.position, b.position)) + a.shape.reach() + motion + norm(obstacle.linear) * time;
        norm(obstacle.linear) + norm(obstacle.angular) * b.shape.reach().min(below)
    }

    fn both(&self, pair: usize) -> (&Solid, &Solid) {
        self.set.sides(pair, &self.solids, &self.fixtures)
    }
}

fn base_of(body: &Body, set: &ObserverSet, observer: usize, other: Other) -> Option<usize> {
    let Other::Observer(o) = other else { return None };
    let (mut a, mut b) = (set.observers[observer].link, set.observers[o].link);
    while a != b {
        let lower = if a > b { &mut a } else { &mut b };
        *lower = body.links[*lower].parent;
    }
    Some(a)
}
