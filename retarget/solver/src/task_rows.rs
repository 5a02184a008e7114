//! Jacobian rows of tasks, written into a hierarchy problem.

use crate::body::Body;
use crate::hierarchy::Problem;
use crate::kinematics::Pose;
use crate::math::*;
use crate::task::{half_spaces, tangents, Task, TaskKind};

/// The velocity coordinates that take part, packed: `(coordinate, column)` of each link's chain.
pub struct Columns {
    pub chain: Vec<Vec<(usize, usize)>>,
    pub all: Vec<(usize, usize)>,
    /// Column of each coordinate; None for a locked one.
    pub of: Vec<Option<usize>>,
}

impl Columns {
    pub fn new(body: &Body, locked: &[bool]) -> Self {
        let mut of = vec![None; body.nv];
        let mut all = vec![];
        for dof in 0..body.nv {
            if !locked[dof] {
                of[dof] = Some(all.len());
                all.push((dof, all.len()));
            }
        }
        let chain =
            body.links.iter().map(|l| l.chain.iter().filter_map(|d| of[*d].map(|c| (*d, c))).collect()).collect();
        Self { chain, all, of }
    }
}

/// Writes the rows of one task from row `first` on.
pub struct RowWriter<'a> {
    pub body: &'a Body,
    pub pose: &'a Pose,
    pub columns: &'a Columns,
    pub problem: &'a mut Problem,
}

impl RowWriter<'_> {
    /// Write rows and targets of `task`, both times `strength`. Returns the share of the error that the rows correct.
    pub fn write(&mut self, task: &Task, target: &[f64], first: usize, strength: f64) -> f64 {
        let (error, share) = self.capped_error(task, target);
        let (body, pose, columns) = (self.body, self.pose, self.columns);
        match &task.kind {
            TaskKind::Position { link, point, from } => {
                let p = body.point(pose, *link, *point);
                let rows = self.open(task, error, first, strength);
                for &(dof, c) in &columns.chain[*link] {
                    self.put(&rows, c, body.point_column(pose, dof, p));
                }
                if let Some((base, local)) = from {
                    let p = body.point(pose, *base, *local);
                    for &(dof, c) in &columns.chain[*base] {
                        self.put(&rows, c, scale(body.point_column(pose, dof, p), -1.0));
                    }
                }
            }
            TaskKind::Orientation { link, .. } => {
                let rows = self.open(task, error, first, strength);
                for &(dof, c) in &columns.chain[*link] {
                    self.put(&rows, c, body.angular_column(pose, dof));
                }
            }
            TaskKind::CentreOfMass { over } => {
                let rows = self.open(task, error, first, strength);
                for &(dof, c) in &columns.all {
                    self.put(&rows, c, body.com_column(pose, dof));
                }
                if let Some(link) = over {
                    let p = pose.position[*link];
                    for &(dof, c) in &columns.chain[*link] {
                        self.put(&rows, c, scale(body.point_column(pose, dof, p), -1.0));
                    }
                }
            }
            TaskKind::Axis { link, axis, eye: None } => {
                let now = mat_vec(&pose.rotation[*link], *axis);
                self.direction_rows(task, *link, now, error, first, strength, |_| [0.0; 3]);
            }
            TaskKind::Axis { link, axis, eye: Some(eye) } => {
                let now = mat_vec(&pose.rotation[*link], *axis);
                let eye = body.point(pose, *link, *eye);
                let line = sub([target[1], target[2], target[3]], eye);
                let distance = norm(line).max(1e-3);
                let d = unit_or(line, now);
                // The motion of the eye turns the desired direction in the opposite sense.
                self.direction_rows(task, *link, now, error, first, strength, |dof| {
                    scale(cross(d, body.point_column(pose, dof, eye)), 1.0 / distance)
                });
            }
            TaskKind::Support { point, max_edges, without } => {
                self.support_rows(task, target, *point, (*max_edges, without), first);
            }
            TaskKind::Posture => self.posture_rows(task, first, strength),
            TaskKind::Observers(_) => {} // `observers::rows` writes theirs
        }
        share
    }

    /// Error times gain, capped, and the share of the error that it is.
    fn capped_error(&self, task: &Task, target: &[f64]) -> (Vec3, f64) {
        let e = task.error(self.body, self.pose, target);
        // A row of weight 0 does not exist, and does not count.
        let counts = |k: usize| task.weight.get(k).is_none_or(|w| *w > 0.0);
        let used: Vec3 = std::array::from_fn(|k| if counts(k) { e[k] } else { 0.0 });
        let size = norm(used) * task.gain;
        let share = if size > task.max_error { task.gain * task.max_error / size } else { task.gain };
        (scale(e, share), share)
    }

    /// Opens the rows with a positive weight: (row, axis, scale).
    fn open(&mut self, task: &Task, error: Vec3, first: usize, strength: f64) -> OpenRows {
        let mut rows = OpenRows { count: 0, row: [0; 3], axis: [0; 3], scale: [0.0; 3] };
        for k in 0..3 {
            let w = task.weight[k];
            if w > 0.0 {
                let r = first + rows.count;
                self.equality(r, w * strength * error[k]);
                rows.row[rows.count] = r;
                rows.axis[rows.count] = k;
                rows.scale[rows.count] = w * strength;
                rows.count += 1;
            }
        }
        rows
    }

    fn equality(&mut self, r: usize, target: f64) {
        self.problem.row_mut(r).fill(0.0);
        self.problem.lower[r] = target;
        self.problem.upper[r] = target;
        self.problem.present[r] = true;
    }

    #[inline(always)]
    fn put(&mut self, rows: &OpenRows, column: usize, value: Vec3) {
        let stride = self.problem.stride;
        for k in 0..rows.count {
            self.problem.rows[rows.row[k] * stride + column] += rows.scale[k] * value[rows.axis[k]];
        }
    }

    #[allow(clippy::too_many_arguments)]
    fn direction_rows(
        &mut self,
        task: &Task,
        link: usize,
        now: Vec3,
        error: Vec3,
        first: usize,
        strength: f64,
        extra: impl Fn(usize) -> Vec3,
    ) {
        let (t1, t2) = tangents(now);
        let (w1, w2) = (task.weight[0] * strength, task.weight[1] * strength);
        self.equality(first, w1 * dot(t1, error));
        self.equality(first + 1, w2 * dot(t2, error));
        let (body, pose, columns) = (self.body, self.pose, self.columns);
        for &(dof, c) in &columns.chain[link] {
            let column = add(body.angular_column(pose, dof), extra(dof));
            self.problem.row_mut(first)[c] = w1 * dot(t1, column);
            self.problem.row_mut(first + 1)[c] = w2 * dot(t2, column);
        }
    }

    /// Rows n . (c + J dq) + m . (p + Jp dq) <= d of all half-spaces. The columns of coordinates in `without` are 0.
    fn support_rows(
        &mut self,
        task: &Task,
        target: &[f64],
        point: Option<(usize, Vec3)>,
        (max_edges, without): (usize, &[usize]),
        first: usize,
    ) {
        let (body, pose, columns) = (self.body, self.pose, self.columns);
        self.problem.present[first..first + max_edges].fill(false);
        let p = point.map_or([0.0; 3], |(link, local)| body.point(pose, link, local));
        for (r, (n, m, d)) in (first..).zip(half_spaces(target, point.is_some(), max_edges)) {
            self.equality(r, 0.0);
            self.problem.lower[r] = f64::NEG_INFINITY;
            let room = d - dot(n, pose.com) - dot(m, p);
            self.problem.upper[r] = room.max(-task.max_error);
            for &(dof, c) in columns.all.iter().filter(|(dof, _)| without.binary_search(dof).is_err()) {
                self.problem.row_mut(r)[c] = dot(n, body.com_column(pose, dof));
            }
            for &(dof, c) in point.iter().flat_map(|(link, _)| &columns.chain[*link]) {
                self.problem.row_mut(r)[c] += dot(m, body.point_column(pose, dof, p));
            }
        }
    }

    /// One row per weighted coordinate. The caller sets the targets from the posture error.
    fn posture_rows(&mut self, task: &Task, first: usize, strength: f64) {
        let mut r = first;
        let columns = self.columns;
        for &(dof, c) in &columns.all {
            if task.weight[dof] > 0.0 {
                self.equality(r, 0.0);
                self.problem.row_mut(r)[c] = task.weight[dof] * strength;
                r += 1;
            }
        }
    }
}

struct OpenRows {
    count: usize,
    row: [usize; 3],
    axis: [usize; 3],
    scale: [f64; 3],
}
