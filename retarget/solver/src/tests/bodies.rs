//! Bodies to try things on.

use crate::body::{Body, Joint, JointKind, Link};
use crate::math::Vec3;

fn link(parent: usize, pos: Vec3, mass: f64, com: Vec3) -> Link {
    Link { parent, pos, quat: [1.0, 0.0, 0.0, 0.0], mass, com, joints: (0, 0), chain: vec![] }
}

fn joint(body: usize, kind: JointKind, axis: Vec3) -> Joint {
    Joint { body, kind, axis, pos: [0.0; 3], q_address: 0, v_address: 0, q_rest: 0.0 }
}

/// The world and a chain of hinges about z, each link `length` m along x.
pub fn chain(count: usize, length: f64) -> Body {
    let mut links = vec![link(0, [0.0; 3], 0.0, [0.0; 3])];
    for k in 0..count {
        let pos = if k == 0 { [0.0; 3] } else { [length, 0.0, 0.0] };
        links.push(link(k, pos, 1.0, [0.5 * length, 0.0, 0.0]));
    }
    let joints = (1..=count).map(|b| joint(b, JointKind::Hinge, [0.0, 0.0, 1.0])).collect();
    Body::new(links, joints).unwrap()
}

/// A free pelvis, two legs of six hinges, two arms of four, a head: 26 hinges with the back. About 1.2 m tall, standing at z = 0.
pub struct Humanoid {
    pub body: Body,
    pub feet: [usize; 2],
    pub hands: [usize; 2],
    pub head: usize,
}

pub fn humanoid() -> Humanoid {
    let (mut links, mut joints) = (vec![link(0, [0.0; 3], 0.0, [0.0; 3])], vec![]);
    let (x, y, z) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]);
    let mut put = |parent: usize, pos: Vec3, mass: f64, com: Vec3, axes: &[Vec3]| {
        links.push(link(parent, pos, mass, com));
        let body = links.len() - 1;
        joints.extend(axes.iter().map(|axis| joint(body, JointKind::Hinge, *axis)));
        body
    };
    let pelvis = put(0, [0.0, 0.0, 0.65], 4.0, [0.0; 3], &[]);
    let trunk = put(pelvis, [0.0, 0.0, 0.1], 8.0, [0.0, 0.0, 0.15], &[z, y]);
    let head = put(trunk, [0.0, 0.0, 0.35], 1.5, [0.0, 0.0, 0.1], &[z, y, x, y]);
    let (mut feet, mut hands) = ([0; 2], [0; 2]);
    for (k, side) in [1.0, -1.0].into_iter().enumerate() {
        let thigh = put(pelvis, [0.0, side * 0.08, 0.0], 2.0, [0.0, 0.0, -0.15], &[z, x, y]);
        let shank = put(thigh, [0.0, 0.0, -0.3], 1.0, [0.0, 0.0, -0.15], &[y]);
        feet[k] = put(shank, [0.0, 0.0, -0.3], 0.5, [0.03, 0.0, -0.03], &[y, x]);
        let upper = put(trunk, [0.0, side * 0.18, 0.3], 0.8, [0.0, 0.0, -0.1], &[y, x, z]);
        hands[k] = put(upper, [0.0, 0.0, -0.25], 0.6, [0.0, 0.0, -0.1], &[y]);
    }
    joints.insert(0, joint(pelvis, JointKind::Free, z));
    Humanoid { body: Body::new(links, joints).unwrap(), feet, hands, head }
}
