//! Whether a path of postures keeps every pair apart, between its rows too.
//!
//! Distance changes by no more than points move: with distances d0 and d1 at the ends of a stretch on which the two sides move by
//! at most s against each other, nothing on it is nearer than (d0 + d1 - s) / 2. What that does not prove is halved.

use super::arms::{arms, Arm};
use super::set::{Observer, ObserverSet, Other};
use super::stage::Stage;
use super::way::Way;
use crate::body::Body;
use crate::geometry::Shape;
use crate::math::{Quat, Vec3};
use std::sync::Arc;

/// Between rows a pair may be nearer by this (m) than at rows: what is sent keeps so much more than what is promised, so that a
/// path along the limit can still be proven by stretches of finite length.
pub const BETWEEN: f64 = 2e-4;
/// A pair that is nearer than it ought to be may come nearer by this (m) in all, not per path: solvers and encoders round.
pub const LET_OUT: f64 = 1e-4;
/// Stretches shorter than 2^-HALVINGS of a row are not halved, and no path is looked at in more than LOOKS postures: what is not
/// proven by then is not clear.
const HALVINGS: i32 = 8;
const LOOKS: u64 = 200;

/// A pair on a stretch of the path. floor: least distance at rows, m; first, last: distances at its ends, m.
#[derive(Clone, Copy)]
struct Doubt {
    pair: usize,
    floor: f64,
    speed: f64,
    first: f64,
    last: f64,
}

/// Nothing is allocated once it has seen a path of the length at hand.
pub struct PathChecker {
    pub stage: Stage,
    /// What pairs shall keep, m.
    keep: Vec<f64>,
    /// Arms of pairs of observers; of observers with obstacles, for each sole that may be planted.
    among: Vec<Vec<Arm>>,
    around: Vec<Vec<Vec<Arm>>>,
    /// Longest arm of each joint, to see at once that a pair is far away.
    longest: Vec<f64>,
    slides: Vec<(usize, f64)>,
    /// The farthest that a pair which is too near has been since it is; -infinity: it is not.
    held: Vec<f64>,
    excused: Vec<bool>,
    doubts: Vec<Doubt>,
    way: Way,
    instead: Way,
    stretch: f64,
    looks_before: u64,
}

impl PathChecker {
    /// movers: velocity coordinates, and columns of a posture, of the joints that a path moves. share: of each pair's margin that
    /// is kept.
    pub fn new(
        body: Arc<Body>,
        set: Arc<ObserverSet>,
        movers: &[usize],
        columns: Vec<usize>,
        soles: Vec<(usize, Vec3)>,
        share: f64,
    ) -> Self {
        let stands = if soles.is_empty() { vec![0] } else { soles.iter().map(|s| s.0).collect() };
        let among: Vec<Vec<Arm>> = set.pairs[..set.self_pairs]
            .iter()
            .map(|p| pair_arms(&body, &set, movers, p.observer, p.other, 0))
            .collect();
        let around: Vec<Vec<Vec<Arm>>> = stands
            .iter()
            .map(|&foot| {
                let with = |o: usize| pair_arms(&body, &set, movers, o, Other::Obstacle(0), foot);
                (0..set.observers.len()).map(with).collect()
            })
            .collect();
        let mut longest = vec![0.0; movers.len()];
        for arm in among.iter().chain(around.iter().flatten()).flatten() {
            longest[arm.mover] = f64::max(longest[arm.mover], arm.length);
        }
        let rest = |dof: usize| body.joints.iter().find(|j| j.v_address == dof).map_or(0.0, |j| j.q_rest);
        let slides =
            movers.iter().enumerate().filter(|(_, d)| body.dof_linear[**d]).map(|(k, d)| (k, rest(*d).abs())).collect();
        Self {
            keep: set.pairs.iter().map(|p| share * p.margin).collect(),
            longest,
            slides,
            held: vec![f64::NEG_INFINITY; set.pairs.len()],
            excused: vec![false; set.pairs.len()],
            doubts: Vec::with_capacity(32 * set.pairs.len()),
            way: Way::default(),
            instead: Way::default(),
            stretch: 0.0,
            looks_before: 0,
            among,
            around,
            stage: Stage::new(body, set, columns, soles),
        }
    }

    /// Forget which pairs were too near.
    pub fn restart(&mut self) {
        self.held.fill(f64::NEG_INFINITY);
    }

    /// Whether every pair keeps apart on a path (rows, movers) that begins now, `dt` s from row to row, the robot standing as in
    /// posture `q`. A pair that is too near at the first row is only let out.
    ///
    /// instead: what the robot does if this path is refused. Where an obstacle comes at the robot, a path on which it is at no row
    /// nearer than on that one is clear of it: a refusal must not keep the robot from getting out of the way.
    /// remember: the first row is where the robot was sent; what is let out is measured from there.
    pub fn is_clear(&mut self, q: &[f64], path: &[f64], instead: Option<&[f64]>, dt: f64, remember: bool) -> bool {
        let n = self.stage.columns.len();
        self.way.load(path, n);
        self.instead.load(instead.unwrap_or(path), n);
        self.stage.dt = dt;
        self.stage.stand(q);
        self.stretch = self.slides.iter().map(|(k, r)| r + self.way.largest(*k).max(self.instead.largest(*k))).sum();
        self.looks_before = self.stage.looks;
        let may_flee = instead.is_some();
        self.doubts.clear();
        self.collect(remember);
        let (end, count) = (self.way.end as f64, self.doubts.len());
        if count == 0 {
            return true;
        }
        self.stage.place(&self.way, end);
        for k in 0..count {
            let pair = self.doubts[k].pair;
            self.doubts[k].last = self.stage.distance(pair);
            self.excused[pair] = false;
        }
        self.holds(0, count, 0.0, end, may_flee)
    }

    /// Root position and orientation with which the planted sole of `q` stays, when the joints take these values.
    pub fn planted(&mut self, q: &[f64], values: &[f64], root: usize) -> (Vec3, Quat) {
        self.way.load(values, self.stage.columns.len());
        self.stage.stand(q);
        self.stage.root(&self.way, 0.0, root)
    }

    fn arms(&self, pair: usize) -> &[Arm] {
        let set = &self.stage.set;
        match pair < set.self_pairs {
            true => &self.among[pair],
            false => &self.around[self.stage.planted][set.pairs[pair].observer],
        }
    }

    /// Pairs that the first row and the length of the path do not clear.
    fn collect(&mut self, remember: bool) {
        self.stage.place(&self.way, 0.0);
        let end = self.way.end as f64;
        let time = end * self.stage.dt;
        let most: f64 =
            self.longest.iter().enumerate().map(|(k, arm)| (arm + self.stretch) * self.way.gone(k, end)).sum();
        for pair in 0..self.keep.len() {
            let floor = self.keep[pair] + BETWEEN;
            let gap = self.stage.gap(pair);
            let speed = self.stage.obstacle_speed(pair, most, time);
            if gap - most - speed * time > floor {
                self.held[pair] = f64::NEG_INFINITY;
                continue;
            }
            let motion = self.way.motion(self.arms(pair), self.stretch, 0.0, end) + speed * time;
            if gap - motion > floor {
                self.held[pair] = f64::NEG_INFINITY;
                continue;
            }
            let first = self.stage.distance(pair);
            let floor = self.least(pair, first, floor, remember);
            if first - motion < floor {
                self.doubts.push(Doubt { pair, floor, speed, first, last: first });
            }
        }
    }

    /// What a pair that is `first` m apart at the first row must keep at rows: `floor`, or what is left of it.
    fn least(&mut self, pair: usize, first: f64, floor: f64, remember: bool) -> f64 {
        if first >= floor {
            if remember {
                self.held[pair] = f64::NEG_INFINITY;
            }
            return floor;
        }
        if !remember {
            return first - LET_OUT;
        }
        // Something pushed it in: what is held is where it is now.
        let lost = first < self.held[pair] - LET_OUT;
        self.held[pair] = if lost { first } else { self.held[pair].max(first) };
        (self.held[pair] - LET_OUT).min(floor)
    }

    /// Whether doubts [start, stop) are clear between two times in rows, at both of which they are known.
    fn holds(&mut self, start: usize, stop: usize, from: f64, to: f64, may_flee: bool) -> bool {
        let (whole, steps) = (to - from > 1.0, to - from);
        let top = self.doubts.len();
        for k in start..stop {
            let doubt = self.doubts[k];
            let between = if whole { doubt.floor } else { doubt.floor - BETWEEN };
            if self.excused[doubt.pair] {
                continue;
            }
            let least = |time: f64| if time.fract() == 0.0 { doubt.floor } else { doubt.floor - BETWEEN };
            if doubt.first < least(from) || doubt.last < least(to) {
                if !self.excuse(doubt.pair, may_flee) {
                    return false;
                }
                continue;
            }
            let motion =
                self.way.motion(self.arms(doubt.pair), self.stretch, from, to) + doubt.speed * steps * self.stage.dt;
            if 0.5 * (doubt.first + doubt.last - motion) < between {
                self.doubts.push(doubt);
            }
        }
        let end = self.doubts.len();
        let clear = end == top || self.halved(top, end, from, to, may_flee);
        self.doubts.truncate(top);
        clear
    }

    /// The same of both halves.
    fn halved(&mut self, start: usize, stop: usize, from: f64, to: f64, may_flee: bool) -> bool {
        let tired = self.stage.looks - self.looks_before > LOOKS || to - from < 0.5f64.powi(HALVINGS);
        if tired {
            return (start..stop).all(|k| self.excuse(self.doubts[k].pair, may_flee));
        }
        let middle = if to - from > 1.0 { (0.5 * (from + to)).floor() } else { 0.5 * (from + to) };
        self.stage.place(&self.way, middle);
        for k in start..stop {
            let mut doubt = self.doubts[k];
            let there = self.stage.distance(doubt.pair);
            self.doubts.push(Doubt { first: there, ..doubt });
            doubt.last = there;
            self.doubts[k] = doubt;
        }
        let later = stop..self.doubts.len();
        self.holds(start, stop, from, middle, may_flee) && self.holds(later.start, later.end, middle, to, may_flee)
    }

    /// Whether an obstacle that comes at the robot is the only one to blame: nowhere nearer than on the path followed instead.
    fn excuse(&mut self, pair: usize, may_flee: bool) -> bool {
        if self.excused[pair] {
            return true;
        }
        if !may_flee || self.stage.moving(pair).is_none() {
            return false;
        }
        let rows = self.way.rows().min(self.instead.rows());
        self.looks_before += 2 * rows as u64; // these count for nobody
        for row in 1..rows {
            self.stage.place(&self.way, row as f64);
            let ours = self.stage.distance(pair);
            self.stage.place(&self.instead, row as f64);
            if ours < self.stage.distance(pair) {
                return false;
            }
        }
        self.excused[pair] = true;
        true
    }
}

/// Arms of a pair; an obstacle stands on the ground, and so does `foot`.
fn pair_arms(body: &Body, set: &ObserverSet, movers: &[usize], observer: usize, other: Other, foot: usize) -> Vec<Arm> {
    let first = &set.observers[observer];
    match other {
        Other::Obstacle(_) => arms(body, movers, first.link, foot, |_| first.clone()),
        Other::Observer(o) => {
            let second = &set.observers[o];
            arms(body, movers, first.link, second.link, |side| {
                let seen = if side == first.link { first } else { second };
                debug_assert!(seen.shape != Shape::HalfSpace);
                Observer::clone(seen)
            })
        }
    }
}
