//! A path of postures in time: rows of joint values, straight in joint space between them; and lever arms: how far from a joint the
//! farthest point of an observer can ever be, whatever the posture.

use super::set::{arm, dof_joint, Observer, ObserverSet, Other, Pair};
use crate::body::{Body, JointKind};
use crate::math::Vec3;

#[derive(Default)]
pub struct Way {
    movers: usize,
    pub rows: usize,
    /// (rows, movers)
    values: Vec<f64>,
    /// How far each joint has gone until each row, (rows, movers).
    gone: Vec<f64>,
    /// Last row at which anything still moves in: from it on the path rests.
    pub end: usize,
}

impl Way {
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

    /// Values at a time in rows, into the entries `columns` of a posture.
    pub fn at(&self, time: f64, columns: &[usize], q: &mut [f64]) {
        let (row, share) = self.place(time);
        let (before, after) = (&self.values[row * self.movers..], &self.values[self.next(row) * self.movers..]);
        for (k, column) in columns.iter().enumerate() {
            q[*column] = if share > 0.0 { before[k] + share * (after[k] - before[k]) } else { before[k] };
        }
    }

    /// How far a joint has gone until a time in rows.
    pub fn gone(&self, mover: usize, time: f64) -> f64 {
        let (row, share) = self.place(time);
        let (before, after) = (self.gone[row * self.movers + mover], self.gone[self.next(row) * self.movers + mover]);
        before + share * (after - before)
    }

    /// Largest size that a joint's value has on the way.
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

/// What the joints do on a stretch of a path. Nothing here needs the posture.
#[derive(Default)]
pub struct Stretch {
    /// How far each joint goes.
    gone: Vec<f64>,
    /// Most that each is off the straight line in joint space from one end to the other.
    off: Vec<f64>,
    /// s from one end to the other.
    pub time: f64,
}

impl Stretch {
    /// Between two times in rows, `dt` s each.
    pub fn load(&mut self, way: &Way, from: f64, to: f64, dt: f64) {
        self.time = (to - from) * dt;
        self.gone.clear();
        self.gone.extend((0..way.movers).map(|k| way.gone(k, to) - way.gone(k, from)));
        self.off.clear();
        self.off.resize(way.movers, 0.0);
        let all: f64 = self.gone.iter().sum();
        if to - from <= 1.0 || all == 0.0 {
            return;
        }
        let (first, last) = (from as usize * way.movers, to as usize * way.movers);
        for row in (from as usize + 1)..to as usize {
            let k = row * way.movers;
            let gone: f64 = (0..way.movers).map(|m| way.gone[k + m] - way.gone[first + m]).sum();
            for (m, off) in self.off.iter_mut().enumerate() {
                let (a, b) = (way.values[first + m], way.values[last + m]);
                *off = off.max((way.values[k + m] - a - gone / all * (b - a)).abs());
            }
        }
    }

    /// Most that the joints of these arms move one side against the other, m. Arms that turn are longer by `stretch`.
    pub fn motion(&self, arms: &[Arm], stretch: f64) -> f64 {
        arms.iter().map(|arm| arm.at_most(stretch) * self.gone[arm.mover]).sum()
    }

    /// Most by which a point is off its straight line on the stretch, m: the acceleration of points is at most 2 S s where joints
    /// turn by S in all and points move by s, and so is eight times the bend of a straight line in joint space.
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

/// How one joint moves one side of a pair against the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arm {
    /// Which of the joints that move on a path.
    pub mover: usize,
    /// Most that a point of the pair moves against the other side, m per rad (m per m for a slide).
    pub length: f64,
    /// A turn: a slide between the joint and the point makes its arm longer.
    pub turns: bool,
}

impl Arm {
    /// Its length where slides on the way are drawn out by `stretch` m.
    pub fn at_most(&self, stretch: f64) -> f64 {
        self.length + if self.turns { stretch } else { 0.0 }
    }
}

/// The arms of every pair.
pub struct Arms {
    /// Of pairs of observers.
    among: Vec<Vec<Arm>>,
    /// Of each observer against the ground, for each sole that may be planted.
    around: Vec<Vec<Vec<Arm>>>,
    /// Longest arm of each joint, to see at once that a pair is far away.
    pub longest: Vec<f64>,
    /// Joints that slide, and their values at rest.
    pub slides: Vec<(usize, f64)>,
    /// The same of slides that no path moves: their places in a posture.
    still: Vec<(usize, f64)>,
}

impl Arms {
    /// movers: velocity coordinates of the joints that move; what is not among them stands still.
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

    /// How far slides that no path moves are drawn out at most in posture `q`, m.
    pub fn drawn_still(&self, q: &[f64]) -> f64 {
        self.still.iter().map(|(address, rest)| q[*address].abs() + rest).sum()
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

/// Arms of the joints that part an observer from another, or from the ground on which the link `foot` stands.
fn parting(body: &Body, movers: &[usize], first: &Observer, second: Option<&Observer>, foot: usize) -> Vec<Arm> {
    let (ours, theirs) = (&body.links[first.link].chain, &body.links[second.map_or(foot, |o| o.link)].chain);
    let arm_of = |(mover, &dof): (usize, &usize)| {
        // What turns with the joint: the observer behind it; the ground reaches any distance, so the observer on it instead.
        let seen = if ours.contains(&dof) { first } else { second.unwrap_or(first) };
        let turns = !body.dof_linear[dof];
        Arm { mover, length: if turns { arm(body, dof, seen) } else { 1.0 }, turns }
    };
    let parts = |dof: &usize| ours.contains(dof) != theirs.contains(dof);
    movers.iter().enumerate().filter(|(_, dof)| parts(dof)).map(arm_of).collect()
}
