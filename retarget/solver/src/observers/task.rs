//! What a level that is made of observers asks for, and which of the observers within influence take part.

use super::set::{Other, Pair};

/// Rows of a pair.
pub const ROWS: usize = 3;

/// Which of the observers within influence put up their row.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Activation {
    /// The closest to each obstacle (paper).
    Closest,
    /// All of them, throughout influence.
    All,
}

/// A task of a level that is made of observers.
#[derive(Clone, Debug, Default)]
pub struct ObserverTask {
    pub reactive: bool,
    /// It names its observers; otherwise all take part.
    pub named: bool,
    /// Observers that take part.
    pub of: Vec<bool>,
    pub with_self: bool,
    pub with_scene: bool,
    /// Approach permitted where influence begins, or speed of the way out of contact, m/s.
    pub speed: f64,
    /// It takes part in this frame.
    pub on: bool,
    /// Place among the tasks of observers.
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

    /// The rows of the pair that is `used` as the n-th: at its nearest points of now, of the posture of rest, and of before. All first
    /// ones come first.
    pub fn rows_of(&self, n: usize) -> [usize; ROWS] {
        std::array::from_fn(|k| self.first_row + k * self.pairs + n)
    }

    /// The first tasks that look at a pair before contact and in contact.
    pub fn of_pair(tasks: &[Self], pair: &Pair) -> (Option<usize>, Option<usize>) {
        let first = |reactive| tasks.iter().position(|t| t.reactive == reactive && t.looks_at(pair));
        (first(false), first(true))
    }
}
