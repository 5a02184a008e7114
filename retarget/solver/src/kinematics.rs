//! Forward kinematics, centre of mass, and the columns of their Jacobians.

use crate::body::{Body, JointKind};
use crate::math::*;

/// Positions (m) and orientations of all links and joint axes in one posture, world frame.
#[derive(Clone, Debug, Default)]
pub struct Pose {
    pub position: Vec<Vec3>,
    pub rotation: Vec<Mat3>,
    pub quat: Vec<Quat>,
    /// World axis and anchor of each velocity coordinate.
    pub axis: Vec<Vec3>,
    pub anchor: Vec<Vec3>,
    /// Mass and mass-weighted centre of the subtree of each link.
    pub subtree_mass: Vec<f64>,
    pub subtree_moment: Vec<Vec3>,
    pub com: Vec3,
}

impl Body {
    pub fn new_pose(&self) -> Pose {
        let n = self.links.len();
        Pose {
            position: vec![[0.0; 3]; n],
            rotation: vec![IDENTITY; n],
            quat: vec![[1.0, 0.0, 0.0, 0.0]; n],
            axis: vec![[0.0; 3]; self.nv],
            anchor: vec![[0.0; 3]; self.nv],
            subtree_mass: vec![0.0; n],
            subtree_moment: vec![[0.0; 3]; n],
            com: [0.0; 3],
        }
    }

    /// Forward kinematics: fills positions, rotations, and the axes of all coordinates.
    pub fn forward(&self, q: &[f64], pose: &mut Pose) {
        for (b, link) in self.links.iter().enumerate() {
            let (mut p, mut r) = (link.pos, link.quat);
            if b > 0 {
                let parent = link.parent;
                p = add(pose.position[parent], mat_vec(&pose.rotation[parent], link.pos));
                r = quat_mul(pose.quat[parent], link.quat);
            }
            let mut m = quat_to_mat(r);
            for joint in &self.joints[link.joints.0..link.joints.1] {
                let (a, v) = (joint.q_address, joint.v_address);
                match joint.kind {
                    JointKind::Free => {
                        p = [q[a], q[a + 1], q[a + 2]];
                        r = quat_unit([q[a + 3], q[a + 4], q[a + 5], q[a + 6]]);
                        m = quat_to_mat(r);
                        for k in 0..3 {
                            pose.axis[v + k] = IDENTITY[k];
                            pose.axis[v + 3 + k] = column(&m, k);
                            pose.anchor[v + 3 + k] = p;
                        }
                    }
                    JointKind::Ball => {
                        let anchor = add(p, mat_vec(&m, joint.pos));
                        r = quat_mul(r, quat_unit([q[a], q[a + 1], q[a + 2], q[a + 3]]));
                        m = quat_to_mat(r);
                        p = sub(anchor, mat_vec(&m, joint.pos));
                        for k in 0..3 {
                            pose.axis[v + k] = column(&m, k);
                            pose.anchor[v + k] = anchor;
                        }
                    }
                    JointKind::Slide => {
                        let axis = mat_vec(&m, joint.axis);
                        p = add(p, scale(axis, q[a] - joint.q_rest));
                        pose.axis[v] = axis;
                    }
                    JointKind::Hinge => {
                        let anchor = add(p, mat_vec(&m, joint.pos));
                        pose.axis[v] = mat_vec(&m, joint.axis);
                        pose.anchor[v] = anchor;
                        r = quat_mul(r, quat_axis_angle(joint.axis, q[a] - joint.q_rest));
                        m = quat_to_mat(r);
                        p = sub(anchor, mat_vec(&m, joint.pos));
                    }
                }
            }
            pose.position[b] = p;
            pose.quat[b] = r;
            pose.rotation[b] = m;
        }
    }

    /// Centre of mass and subtree sums; needs `forward` first.
    pub fn mass_properties(&self, pose: &mut Pose) {
        for (b, link) in self.links.iter().enumerate() {
            let c = add(pose.position[b], mat_vec(&pose.rotation[b], link.com));
            pose.subtree_mass[b] = link.mass;
            pose.subtree_moment[b] = scale(c, link.mass);
        }
        // From the leaves to the root: links come after their parents, so a subtree is complete when it is added.
        for b in (1..self.links.len()).rev() {
            let parent = self.links[b].parent;
            pose.subtree_mass[parent] += pose.subtree_mass[b];
            pose.subtree_moment[parent] = add(pose.subtree_moment[parent], pose.subtree_moment[b]);
        }
        let mass = if self.total_mass > 0.0 { self.total_mass } else { 1.0 };
        pose.com = scale(pose.subtree_moment[0], 1.0 / mass);
    }

    #[inline(always)]
    pub fn point(&self, pose: &Pose, link: usize, local: Vec3) -> Vec3 {
        add(pose.position[link], mat_vec(&pose.rotation[link], local))
    }

    /// Column of the Jacobian of a world point, for a coordinate in its chain.
    #[inline(always)]
    pub fn point_column(&self, pose: &Pose, dof: usize, point: Vec3) -> Vec3 {
        if self.dof_linear[dof] {
            pose.axis[dof]
        } else {
            cross(pose.axis[dof], sub(point, pose.anchor[dof]))
        }
    }

    /// Column of the angular Jacobian, for a coordinate in the link's chain.
    #[inline(always)]
    pub fn angular_column(&self, pose: &Pose, dof: usize) -> Vec3 {
        if self.dof_linear[dof] {
            [0.0; 3]
        } else {
            pose.axis[dof]
        }
    }

    /// Column of the centre-of-mass Jacobian; needs `mass_properties` first.
    #[inline(always)]
    pub fn com_column(&self, pose: &Pose, dof: usize) -> Vec3 {
        let link = self.dof_link[dof];
        let share = if self.total_mass > 0.0 { 1.0 / self.total_mass } else { 0.0 };
        let mass = pose.subtree_mass[link];
        if self.dof_linear[dof] {
            return scale(pose.axis[dof], mass * share);
        }
        // A turn moves the subtree's centre as a point: axis x (centre - anchor), weighted by its share of the mass.
        let arm = sub(pose.subtree_moment[link], scale(pose.anchor[dof], mass));
        scale(cross(pose.axis[dof], arm), share)
    }
}
