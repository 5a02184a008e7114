//! Layout of the linear problem: slices of the target vector, rows and slack variables of all tasks, and rows of observers.

use crate::body::Body;
use crate::observers::{Activation, ObserverSet, ObserverTask, PairMonitor};
use crate::task::{Task, TaskKind};
use crate::task_rows::Columns;
use std::ops::Range;
use std::sync::Arc;

/// Most pairs of one task that have rows. If more are within influence, those with the least room, now or at rest, get them.
const MOST_PAIRS: usize = 128;

/// A task's place in the target vector and among the rows.
pub struct Placed {
    pub task: Task,
    pub target: Range<usize>,
    pub first_row: usize,
    pub level: usize,
    /// In the last level beside a posture: its rows get a slack variable each, from this column on.
    pub soft_column: Option<usize>,
    /// A posture of the last level: it is the metric, and has no rows.
    pub metric: bool,
}

pub struct Layout {
    pub placed: Vec<Placed>,
    pub target_size: usize,
    pub level_rows: Vec<usize>,
    /// Free coordinates and slack variables.
    pub variables: usize,
    /// The last level has a posture, which is the metric.
    pub soft_last: bool,
}

impl Layout {
    /// `free` coordinates take part; locked ones lose their posture weight.
    pub fn new(body: &Body, levels: Vec<Vec<Task>>, locked: &[bool], free: usize) -> Self {
        let last = levels.len().saturating_sub(1);
        let mut placed = vec![];
        let (mut target, mut row, mut soft) = (0, 0, free);
        let mut level_rows = vec![0; levels.len()];
        for (level, tasks) in levels.into_iter().enumerate() {
            let soft_level = level == last && tasks.iter().any(|t| matches!(t.kind, TaskKind::Posture));
            for mut task in tasks {
                if matches!(task.kind, TaskKind::Posture) {
                    for dof in 0..body.nv {
                        if locked[dof] {
                            task.weight[dof] = 0.0;
                        }
                    }
                }
                let size = 1 + task.target_size(body);
                let metric = soft_level && matches!(task.kind, TaskKind::Posture);
                let rows = if metric { 0 } else { task.row_count() };
                let is_limit = matches!(task.kind, TaskKind::Support { .. } | TaskKind::Observers(_));
                let soft_column = (soft_level && !metric && !is_limit).then_some(soft);
                if soft_column.is_some() {
                    soft += rows;
                }
                placed.push(Placed { task, target: target..target + size, first_row: row, level, soft_column, metric });
                target += size;
                row += rows;
                level_rows[level] += rows;
            }
        }
        let soft_last = placed.iter().any(|p: &Placed| p.metric);
        Self { placed, target_size: target, level_rows, variables: soft, soft_last }
    }
}

/// Reserve rows in every task of observers for the pairs that it looks at.
pub fn reserve_rows(levels: &mut [Vec<Task>], set: &ObserverSet) {
    for task in levels.iter_mut().flatten() {
        if let TaskKind::Observers(task) = &mut task.kind {
            task.pairs = set.pairs.iter().filter(|pair| task.looks_at(pair)).count().min(MOST_PAIRS);
        }
    }
}

/// The monitor of all pairs, with the rows that the layout gave the tasks of observers.
pub fn monitor(
    body: &Body,
    columns: &Columns,
    placed: &mut [Placed],
    set: Arc<ObserverSet>,
    activation: Activation,
) -> PairMonitor {
    let mut tasks = vec![];
    for p in placed {
        if let TaskKind::Observers(task) = &mut p.task.kind {
            (task.index, task.first_row) = (tasks.len(), p.first_row);
            tasks.push(ObserverTask { used: Vec::with_capacity(task.pairs), ..task.clone() });
        }
    }
    PairMonitor::new(set, tasks, activation, &columns.of, body)
}
