//! Lever arms: how far from a joint the farthest point of an observer can ever be, whatever the posture.

use super::set::Observer;
use crate::body::{Body, JointKind};
use crate::math::norm;

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

/// Arms of the joints that part `link` from `other`, for an observer that hangs on one of them.
///
/// `movers`: velocity coordinates of the joints that move; what is not among them stands still.
pub fn arms(body: &Body, movers: &[usize], link: usize, other: usize, seen: impl Fn(usize) -> Observer) -> Vec<Arm> {
    let (ours, theirs) = (&body.links[link].chain, &body.links[other].chain);
    let parts = |dof: &usize| ours.contains(dof) != theirs.contains(dof);
    movers
        .iter()
        .enumerate()
        .filter(|(_, dof)| parts(dof))
        .map(|(mover, &dof)| {
            let side = if ours.contains(&dof) { link } else { other };
            let turns = !body.dof_linear[dof];
            let length = if turns { arm(body, dof, &seen(side)) } else { 1.0 };
            Arm { mover, length, turns }
        })
        .collect()
}

/// Length (m) of the way along the body from a joint to the farthest point of an observer: no posture takes it farther.
fn arm(body: &Body, dof: usize, observer: &Observer) -> f64 {
    let joint = dof_joint(body, dof);
    let from = body.joints[joint].body;
    let later = &body.joints[joint + 1..body.links[from].joints.1];
    let off: f64 = norm(body.joints[joint].pos) + later.iter().map(|j| 2.0 * norm(j.pos)).sum::<f64>();
    off + way(body, from, observer.link) + norm(observer.position) + observer.shape.reach()
}

fn dof_joint(body: &Body, dof: usize) -> usize {
    body.joints.iter().rposition(|j| j.v_address <= dof).unwrap_or(0)
}

/// Length (m) of the way along the body from the origin of one link to that of another.
fn way(body: &Body, from: usize, to: usize) -> f64 {
    let (mut a, mut b, mut length) = (from, to, 0.0);
    while a != b {
        let lower = if a > b { &mut a } else { &mut b };
        length += edge(body, *lower);
        *lower = body.links[*lower].parent;
    }
    length
}

/// Most that a link's origin is away from its parent's, m, slides at rest. A turn about a point swings the origin around it.
fn edge(body: &Body, link: usize) -> f64 {
    let link = &body.links[link];
    let swung = |joint: &crate::body::Joint| if joint.kind == JointKind::Slide { 0.0 } else { 2.0 * norm(joint.pos) };
    norm(link.pos) + body.joints[link.joints.0..link.joints.1].iter().map(swung).sum::<f64>()
}
