//! A body: a tree of links joined by free, ball, slide and hinge joints (MuJoCo's conventions).
//!
//! `q` holds a free joint as position xyz and quaternion wxyz, a ball joint as wxyz. `dq` holds a free
//! joint as world linear then body-local angular velocity, a ball joint as body-local angular velocity.

use crate::math::*;

#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum JointKind {
    Free,
    Ball,
    Slide,
    Hinge,
}

impl JointKind {
    /// (entries in q, entries in dq)
    pub fn size(self) -> (usize, usize) {
        match self {
            Self::Free => (7, 6),
            Self::Ball => (4, 3),
            Self::Slide | Self::Hinge => (1, 1),
        }
    }
}

#[derive(Clone, Debug)]
pub struct Joint {
    pub body: usize,
    pub kind: JointKind,
    pub axis: Vec3,
    pub pos: Vec3,
    pub q_address: usize,
    pub v_address: usize,
    /// Value of q at the rest geometry (hinge and slide only).
    pub q_rest: f64,
}

#[derive(Clone, Debug)]
pub struct Link {
    pub parent: usize,
    pub pos: Vec3,
    pub quat: Quat,
    pub mass: f64,
    pub com: Vec3,
    /// Joints of this link, in order: `joints[first..end]`.
    pub joints: (usize, usize),
    /// Velocity coordinates that move this link, ascending.
    pub chain: Vec<usize>,
}

#[derive(Clone, Debug)]
pub struct Body {
    pub links: Vec<Link>,
    pub joints: Vec<Joint>,
    pub nq: usize,
    pub nv: usize,
    /// Link of each velocity coordinate.
    pub dof_link: Vec<usize>,
    /// True for a translation (slide, or the linear part of a free joint).
    pub dof_linear: Vec<bool>,
    /// True for the coordinates of a free joint.
    pub dof_is_root: Vec<bool>,
    pub total_mass: f64,
}

impl Body {
    /// Links and joints must be sorted: a parent before its children, joints by link.
    pub fn new(mut links: Vec<Link>, mut joints: Vec<Joint>) -> Result<Self, String> {
        if links.is_empty() {
            return Err("a body needs at least the world link".into());
        }
        let (mut nq, mut nv) = (0, 0);
        let (mut dof_link, mut dof_linear, mut dof_is_root) = (vec![], vec![], vec![]);
        for (j, joint) in joints.iter_mut().enumerate() {
            if joint.body >= links.len() {
                return Err(format!("joint {j} sits on link {}, of {}", joint.body, links.len()));
            }
            joint.q_address = nq;
            joint.v_address = nv;
            let (size_q, size_v) = joint.kind.size();
            nq += size_q;
            nv += size_v;
            for k in 0..size_v {
                dof_link.push(joint.body);
                dof_is_root.push(joint.kind == JointKind::Free);
                dof_linear.push(joint.kind == JointKind::Slide || joint.kind == JointKind::Free && k < 3);
            }
            joint.axis = unit_or(joint.axis, [0.0, 0.0, 1.0]);
        }
        for b in 0..links.len() {
            let first = joints.iter().position(|j| j.body == b);
            let count = joints.iter().filter(|j| j.body == b).count();
            let first = first.unwrap_or(0);
            if joints[first..(first + count).min(joints.len())].iter().any(|j| j.body != b) {
                return Err(format!("the joints of link {b} are not contiguous"));
            }
            links[b].joints = (first, first + count);
            if b > 0 && links[b].parent >= b {
                return Err(format!("link {b} comes before its parent {}", links[b].parent));
            }
            let mut chain = if b > 0 { links[links[b].parent].chain.clone() } else { vec![] };
            for joint in &joints[first..first + count] {
                chain.extend(joint.v_address..joint.v_address + joint.kind.size().1);
            }
            chain.sort_unstable();
            links[b].chain = chain;
            links[b].quat = quat_unit(links[b].quat);
        }
        let total_mass = links.iter().map(|l| l.mass).sum();
        Ok(Self { links, joints, nq, nv, dof_link, dof_linear, dof_is_root, total_mass })
    }

    /// Reach of the stretched body, m: the longest path from a top link to the origin of another; 1 if there is none.
    pub fn size(&self) -> f64 {
        let mut reach = vec![0.0; self.links.len()];
        for (b, link) in self.links.iter().enumerate().skip(1) {
            if link.parent > 0 {
                reach[b] = reach[link.parent] + norm(link.pos);
            }
        }
        let longest = reach.iter().fold(0.0, |a: f64, b| a.max(*b));
        if longest > 0.0 {
            longest
        } else {
            1.0
        }
    }

    /// Rest posture: joints at their rest values, free and ball joints at the link's own frame.
    pub fn rest(&self) -> Vec<f64> {
        let mut q = vec![0.0; self.nq];
        for joint in &self.joints {
            let a = joint.q_address;
            match joint.kind {
                JointKind::Free => {
                    q[a..a + 3].copy_from_slice(&self.links[joint.body].pos);
                    q[a + 3..a + 7].copy_from_slice(&self.links[joint.body].quat);
                }
                JointKind::Ball => q[a] = 1.0,
                _ => q[a] = joint.q_rest,
            }
        }
        q
    }

    /// q <- q (+) dq
    pub fn integrate(&self, q: &mut [f64], dq: &[f64]) {
        for joint in &self.joints {
            let (a, v) = (joint.q_address, joint.v_address);
            match joint.kind {
                JointKind::Free => {
                    for k in 0..3 {
                        q[a + k] += dq[v + k];
                    }
                    turn(&mut q[a + 3..a + 7], [dq[v + 3], dq[v + 4], dq[v + 5]]);
                }
                JointKind::Ball => turn(&mut q[a..a + 4], [dq[v], dq[v + 1], dq[v + 2]]),
                _ => q[a] += dq[v],
            }
        }
    }

    /// dq with `from (+) dq = to`
    pub fn difference(&self, from: &[f64], to: &[f64], dq: &mut [f64]) {
        for joint in &self.joints {
            let (a, v) = (joint.q_address, joint.v_address);
            match joint.kind {
                JointKind::Free => {
                    for k in 0..3 {
                        dq[v + k] = to[a + k] - from[a + k];
                    }
                    dq[v + 3..v + 6].copy_from_slice(&turn_between(&from[a + 3..a + 7], &to[a + 3..a + 7]));
                }
                JointKind::Ball => {
                    dq[v..v + 3].copy_from_slice(&turn_between(&from[a..a + 4], &to[a..a + 4]));
                }
                _ => dq[v] = to[a] - from[a],
            }
        }
    }
}

fn turn(q: &mut [f64], rotation: Vec3) {
    let turned = quat_unit(quat_mul(quat_unit([q[0], q[1], q[2], q[3]]), quat_exp(rotation)));
    q.copy_from_slice(&turned);
}

fn turn_between(from: &[f64], to: &[f64]) -> Vec3 {
    let from = quat_unit([from[0], from[1], from[2], from[3]]);
    let to = quat_unit([to[0], to[1], to[2], to[3]]);
    quat_log(quat_mul(quat_conj(from), to))
}
