//! Tasks of a level of observers.

use super::set::{Other, Pair};

/// Rows of a pair.
pub const ROWS: usize = 3;

/// The observers within influence that have rows.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Activation {
    /// The closest one to each obstacle (paper).
    Closest,
    /// All of them.
    All,
}

/// A task of a level of observers.
#[derive(Clone, Debug, Default)]
pub struct ObserverTask {
    pub reactive: bool,
    /// True if the task names its observers; otherwise all take part.
    pub named: bool,
    /// True for the observers that take part.
    pub of: Vec<bool>,
    pub with_self: bool,
    pub with_scene: bool,
    /// Permitted approach at the influence distance, or speed of separation from contact, m/s.
    pub speed: f64,
    /// True if the task takes part in this frame.
    pub on: bool,
    /// Index among the tasks of observers.
    pub index: usize,
    pub first_row: usize,
    /// Most pairs that may have rows at once.
    pub pairs: usize,
    /// Pairs that have a row in this iteration, in order.
    pub used: Vec<usize>,
}

impl ObserverTask {
    pub fn looks_at(&self, pair: &Pair) -> bool {
        match pair.other {
            Other::Observer(other) => self.with_self && (self.of[pair.observer] || self.of[other]),
            Other::Obstacle(_) => self.with_scene && self.of[pair.observer],
        }
    }

    /// The rows of the n-th pair of `used`: at its nearest points now, at rest, and before. The first rows of all pairs come first.
    pub fn rows_of(&self, n: usize) -> [usize; ROWS] {
        std::array::from_fn(|k| self.first_row + k * self.pairs + n)
    }
}
