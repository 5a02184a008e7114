//! Tasks of a body, and their errors.

use crate::body::Body;
use crate::kinematics::Pose;
use crate::math::*;
use crate::observers::{ObserverTask, ROWS};

#[derive(Clone, Debug)]
pub enum TaskKind {
    /// A point of a link goes to a world position, or to an offset (world axes) from a point of another link.
    Position { link: usize, point: Vec3, from: Option<(usize, Vec3)> },
    /// A frame of a link takes a world orientation.
    Orientation { link: usize, quat: Quat },
    /// An axis of a link points along a world direction, or, from a point of the link, aims at a world point.
    Axis { link: usize, axis: Vec3, eye: Option<Vec3> },
    /// The centre of mass goes to a world position, or keeps an offset from a link's origin.
    CentreOfMass { over: Option<usize> },
    /// The centre of mass, or it and a point of a link, stays inside at most `max_edges` half-spaces, as those over a support polygon
    /// or those of the load of a joint. `without`: coordinates that do not take part, ascending.
    Support { point: Option<(usize, Vec3)>, max_edges: usize, without: Vec<usize> },
    /// Every coordinate goes to that of a posture.
    Posture,
    /// Observers keep their parts off obstacles and off each other.
    Observers(ObserverTask),
}

#[derive(Clone, Debug)]
pub struct Task {
    pub kind: TaskKind,
    /// One weight per row (3 for points and orientations, 2 for directions, nv for a posture).
    pub weight: Vec<f64>,
    /// Share of the error corrected per iteration.
    pub gain: f64,
    /// Largest error norm that an iteration corrects (m or rad; per coordinate for a posture).
    pub max_error: f64,
}

impl Task {
    /// Entries in the target vector after the leading weight.
    pub fn target_size(&self, body: &Body) -> usize {
        match self.kind {
            TaskKind::Orientation { .. } => 4,
            TaskKind::Support { point, max_edges, .. } => half_space_size(point.is_some()) * max_edges,
            TaskKind::Posture => body.nq,
            TaskKind::Observers(_) => 0,
            _ => 3,
        }
    }

    /// Rows of the hierarchy that this task may use.
    pub fn row_count(&self) -> usize {
        match self.kind {
            TaskKind::Support { max_edges, .. } => max_edges,
            TaskKind::Observers(ref task) => ROWS * task.pairs,
            _ => self.weight.iter().filter(|w| **w > 0.0).count(),
        }
    }

    /// True if this frame has the task: a positive leading weight and a finite target.
    pub fn is_present(&self, target: &[f64]) -> bool {
        target[0] > 0.0 && target.iter().all(|v| v.is_finite())
    }
}

/// Directional error: rotation vector that turns unit `from` onto unit `to`.
pub fn turn_error(from: Vec3, to: Vec3) -> Vec3 {
    let c = cross(from, to);
    let (s, d) = (norm(c), dot(from, to));
    if s < 1e-9 {
        return if d > 0.0 { c } else { scale(perpendicular(from), std::f64::consts::PI) };
    }
    scale(c, libm::atan2(s, d) / s)
}

/// Two unit vectors that complete the unit vector `a`.
pub fn tangents(a: Vec3) -> (Vec3, Vec3) {
    let t = perpendicular(a);
    (t, cross(a, t))
}

impl Task {
    /// Unweighted error of a three-row task (m or rad, world frame); zero for limits and postures.
    pub fn error(&self, body: &Body, pose: &Pose, target: &[f64]) -> Vec3 {
        let goal = [target[1], target[2], target[3]];
        match &self.kind {
            TaskKind::Position { link, point, from } => {
                let base = from.map_or([0.0; 3], |(link, local)| body.point(pose, link, local));
                sub(add(goal, base), body.point(pose, *link, *point))
            }
            TaskKind::Orientation { link, quat } => {
                let now = quat_mul(pose.quat[*link], *quat);
                let desired = quat_unit([target[1], target[2], target[3], target[4]]);
                quat_log(quat_mul(desired, quat_conj(now)))
            }
            TaskKind::Axis { link, axis, eye } => {
                let now = mat_vec(&pose.rotation[*link], *axis);
                let desired = match eye {
                    Some(eye) => unit_or(sub(goal, body.point(pose, *link, *eye)), now),
                    None => unit_or(goal, [1.0, 0.0, 0.0]),
                };
                turn_error(now, desired)
            }
            TaskKind::CentreOfMass { over } => {
                let from = over.map_or([0.0; 3], |link| pose.position[link]);
                sub(add(goal, from), pose.com)
            }
            TaskKind::Support { .. } | TaskKind::Posture | TaskKind::Observers(_) => [0.0; 3],
        }
    }

    /// Error norm for reports: distance for points, angle for directions, depth outside for support.
    pub fn error_size(&self, body: &Body, pose: &Pose, target: &[f64]) -> f64 {
        match &self.kind {
            TaskKind::Support { point, max_edges, .. } => {
                let p = point.map_or([0.0; 3], |(link, local)| body.point(pose, link, local));
                let depth =
                    half_spaces(target, point.is_some(), *max_edges).map(|(n, m, d)| dot(n, pose.com) + dot(m, p) - d);
                depth.fold(0.0, f64::max)
            }
            TaskKind::Posture | TaskKind::Observers(_) => 0.0,
            TaskKind::Axis { .. } => norm(self.error(body, pose, target)),
            _ => {
                let e = self.error(body, pose, target);
                norm(std::array::from_fn(|k| if self.weight[k] > 0.0 { e[k] } else { 0.0 }))
            }
        }
    }
}

/// Number of entries of one half-space in a target: nx, ny, nz, d, and mx, my, mz before d if it has a point.
fn half_space_size(with_point: bool) -> usize {
    4 + 3 * usize::from(with_point)
}

/// The half-spaces n . c + m . p <= d of a support target that are in use, as (n, m, d); m is zero without a point.
pub fn half_spaces(target: &[f64], with_point: bool, max_edges: usize) -> impl Iterator<Item = (Vec3, Vec3, f64)> + '_ {
    let size = half_space_size(with_point);
    let used = move |e: &&[f64]| e[..size - 1].iter().any(|n| *n != 0.0);
    target[1..].chunks_exact(size).take(max_edges).filter(used).map(move |e| {
        let of_point = if with_point { [e[3], e[4], e[5]] } else { [0.0; 3] };
        ([e[0], e[1], e[2]], of_point, e[size - 1])
    })
}
