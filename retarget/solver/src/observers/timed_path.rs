//! A path of postures in time: rows of joint values, straight in joint space between them. And lever arms: the greatest distance
//! from a joint to a point of an observer in any posture.

use super::set::{arm, dof_joint, Observer, ObserverSet, Other, Pair};
use crate::body::{Body, JointKind};
use crate::math::Vec3;

#[derive(Default)]
pub struct TimedPath {
    movers: usize,
    pub rows: usize,
    /// (rows, movers)
    values: Vec<f64>,
    /// Length of the path of each joint up to each row, (rows, movers).
    gone: Vec<f64>,
    /// Last row before which anything moves.
    pub end: usize,
}

impl TimedPath {
    /// Take over rows of values; at least one.
    pub fn load(&mut self, values: &[f64], movers: usize) {
        (self.movers, self.rows, self.end) = (movers, values.len() / movers, 0);
        self.values.clear();
        self.values.extend_from_slice(values);
        self.gone.clear();
        self.gone.resize(values.len(), 0.0);
        for k in movers..values.len() {
            let step = (values[k] - values[k - movers]).abs();
            self.gone[k] = self.gone[k - movers] + step;
            if step > 0.0 {
                self.end = k / movers;
            }
        }
    }

    /// Write the values at a time in rows into the entries `columns` of a posture.
    pub fn at(&self, time: f64, columns: &[usize], q: &mut [f64]) {
        let (row, share) = self.place(time);
        let (before, after) = (&self.values[row * self.movers..], &self.values[self.next(row) * self.movers..]);
        for (k, column) in columns.iter().enumerate() {
            q[*column] = if share > 0.0 { before[k] + share * (after[k] - before[k]) } else { before[k] };
        }
    }

    /// Length of the path of a joint up to a time in rows.
    pub fn gone(&self, mover: usize, time: f64) -> f64 {
        let (row, share) = self.place(time);
        let (before, after) = (self.gone[row * self.movers + mover], self.gone[self.next(row) * self.movers + mover]);
        before + share * (after - before)
    }

    /// Largest absolute value of a joint on the path.
    pub fn largest(&self, mover: usize) -> f64 {
        self.values.iter().skip(mover).step_by(self.movers).fold(0.0, |a: f64, v| a.max(v.abs()))
    }

    fn place(&self, time: f64) -> (usize, f64) {
        let row = (time as usize).min(self.rows - 1);
        (row, time - row as f64)
    }

    fn next(&self, row: usize) -> usize {
        (row + 1).min(self.rows - 1)
    }
}

/// Motion of the joints on a stretch of a path. Nothing here needs the posture.
#[derive(Default)]
pub struct Stretch {
    /// Length of the path of each joint.
    gone: Vec<f64>,
    /// Most deviation of each joint from the straight line in joint space between the ends.
    off: Vec<f64>,
    /// Time from one end to the other, s.
    pub time: f64,
}

impl Stretch {
    /// Between two times in rows, `dt` s each.
    pub fn load(&mut self, path: &TimedPath, from: f64, to: f64, dt: f64) {
        self.time = (to - from) * dt;
        self.gone.clear();
        self.gone.extend((0..path.movers).map(|k| path.gone(k, to) - path.gone(k, from)));
        self.off.clear();
        self.off.resize(path.movers, 0.0);
        let all: f64 = self.gone.iter().sum();
        if to - from <= 1.0 || all == 0.0 {
            return;
        }
        let (first, last) = (from as usize * path.movers, to as usize * path.movers);
        for row in (from as usize + 1)..to as usize {
            let k = row * path.movers;
            let gone: f64 = (0..path.movers).map(|m| path.gone[k + m] - path.gone[first + m]).sum();
            for (m, off) in self.off.iter_mut().enumerate() {
                let (a, b) = (path.values[first + m], path.values[last + m]);
                *off = off.max((path.values[k + m] - a - gone / all * (b - a)).abs());
            }
        }
    }

    /// Bound of the motion of one side against the other by the joints of these arms, m. Arms that turn are longer by `stretch`.
    pub fn motion(&self, arms: &[Arm], stretch: f64) -> f64 {
        arms.iter().map(|arm| arm.at_most(stretch) * self.gone[arm.mover]).sum()
    }

    /// Bound of the deviation of a point from its straight line on the stretch, m. If joints turn by S in all and points move by s, the
    /// acceleration of points is at most 2 S s, and so is eight times the bend of a straight line in joint space.
    pub fn bend(&self, arms: &[Arm], stretch: f64) -> f64 {
        let (mut turned, mut moved, mut off) = (0.0, 0.0, 0.0);
        for arm in arms {
            let length = arm.at_most(stretch);
            turned += if arm.turns { self.gone[arm.mover] } else { 0.0 };
            moved += length * self.gone[arm.mover];
            off += length * self.off[arm.mover];
        }
        0.25 * turned * moved + off
    }
}

/// Lever arm of one joint that moves one side of a pair against the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Index among the joints that move on a path.
    pub mover: usize,
    /// Most motion of a point of the pair against the other side, m per rad (m per m for a slide).
    pub length: f64,
    /// True for a turn, whose arm a slide between the joint and the point makes longer.
    pub turns: bool,
}

impl Arm {
    /// Its length if the slides in between are extended by `stretch` m.
    pub fn at_most(&self, stretch: f64) -> f64 {
        self.length + if self.turns { stretch } else { 0.0 }
    }
}

/// The arms of every pair.
pub struct Arms {
    /// Arms of pairs of observers.
    among: Vec<Vec<Arm>>,
    /// Arms of each observer against the ground, for each sole that may be planted.
    around: Vec<Vec<Vec<Arm>>>,
    /// Longest arm of each joint, a quick test for pairs that are far away.
    pub longest: Vec<f64>,
    /// Slides that move on a path, and their sizes at rest.
    pub slides: Vec<(usize, f64)>,
    /// Index in a posture of other slides, and their sizes at rest.
    pub still: Vec<(usize, f64)>,
}

impl Arms {
    /// movers: velocity coordinates of the joints that move. All others stand still.
    pub fn new(body: &Body, set: &ObserverSet, movers: &[usize], soles: &[(usize, Vec3)]) -> Self {
        let stands = if soles.is_empty() { vec![0] } else { soles.iter().map(|s| s.0).collect() };
        let between = |p: &Pair| match p.other {
            Other::Observer(o) => parting(body, movers, &set.observers[p.observer], Some(&set.observers[o]), 0),
            Other::Obstacle(_) => vec![],
        };
        let among: Vec<Vec<Arm>> = set.pairs[..set.self_pairs].iter().map(between).collect();
        let on_ground = |foot: usize| set.observers.iter().map(|o| parting(body, movers, o, None, foot)).collect();
        let around: Vec<Vec<Vec<Arm>>> = stands.into_iter().map(on_ground).collect();
        let mut longest = vec![0.0; movers.len()];
        for arm in among.iter().chain(around.iter().flatten()).flatten() {
            longest[arm.mover] = f64::max(longest[arm.mover], arm.length);
        }
        let rest = |dof: usize| body.joints[dof_joint(body, dof)].q_rest.abs();
        let slides = movers.iter().enumerate().filter(|(_, d)| body.dof_linear[**d]).map(|(k, d)| (k, rest(*d)));
        let slides = slides.collect();
        let others = body.joints.iter().filter(|j| j.kind == JointKind::Slide && !movers.contains(&j.v_address));
        let still = others.map(|j| (j.q_address, j.q_rest.abs())).collect();
        Self { among, around, longest, slides, still }
    }

    /// Arms of a pair while a sole is planted.
    pub fn of(&self, set: &ObserverSet, pair: usize, planted: usize) -> &[Arm] {
        if pair < set.self_pairs {
            &self.among[pair]
        } else {
            &self.around[planted][set.pairs[pair].observer]
        }
    }
}

/// Arms of the joints that move an observer against another, or against the ground on which the link `foot` stands.
fn parting(body: &Body, movers: &[usize], first: &Observer, second: Option<&Observer>, foot: usize) -> Vec<Arm> {
    let (ours, theirs) = (&body.links[first.link].chain, &body.links[second.map_or(foot, |o| o.link)].chain);
    let arm_of = |(mover, &dof): (usize, &usize)| {
        // The joint turns the observer behind it. The ground has no bounds, so an observer on it is taken instead.
        let seen = if ours.contains(&dof) { first } else { second.unwrap_or(first) };
        let turns = !body.dof_linear[dof];
        Arm { mover, length: if turns { arm(body, dof, seen) } else { 1.0 }, turns }
    };
    let parts = |dof: &usize| ours.contains(dof) != theirs.contains(dof);
    movers.iter().enumerate().filter(|(_, dof)| parts(dof)).map(arm_of).collect()
}
