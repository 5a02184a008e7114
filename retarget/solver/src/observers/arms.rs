//! Lever arms: how far from a joint the farthest point of an observer can ever be, whatever the posture.

use super::set::{arm, dof_joint, Observer, ObserverSet, Other, Pair};
use crate::body::{Body, JointKind};
use crate::math::Vec3;

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
        if self.turns {
            self.length + stretch
        } else {
            self.length
        }
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
