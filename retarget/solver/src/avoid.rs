//! Observers inside the convergence loop: their rows in the problem of one iteration, and the second solve that a trial requires.

use crate::frame::FrameSolver;
use crate::hierarchy::solve;
use crate::observers::{Activation, Shift};

/// Solves of one iteration in which pairs may still ask for a row.
const MOST_SURPRISES: usize = 4;

impl FrameSolver {
    /// Solve the iteration's problem with the rows of the observers.
    pub(crate) fn solve_observed(&mut self, first: bool) {
        let Some(watch) = &mut self.watch else {
            self.solve_once();
            return;
        };
        let shift = Shift { reference: &self.reference, scale: &self.scale };
        let is_trial = watch.write_rows(&self.body, &self.pose, &mut self.problem, &shift, first);
        let acts = watch.activation;
        // Damping lowers targets where it solves.
        self.asked.0.clone_from(&self.problem.lower);
        self.asked.1.clone_from(&self.problem.upper);
        self.solve_once();
        if acts == Activation::All {
            self.solve_surprises(first);
        } else if is_trial {
            self.ask_again();
            if self.watch.as_mut().is_some_and(|watch| watch.choose(&mut self.problem)) {
                self.solve_once();
            }
        }
        if let Some(watch) = &mut self.watch {
            watch.keep_sides(&self.problem, first);
        }
    }

    /// Solve again with the rows of pairs that the answer would bring too near although they had no row.
    fn solve_surprises(&mut self, first: bool) {
        for _ in 0..MOST_SURPRISES {
            self.read_step();
            let Some(watch) = &mut self.watch else { return };
            let before = watch.wake_surprised(&self.step);
            if watch.near.len() == before {
                return;
            }
            self.ask_again();
            let Some(watch) = &mut self.watch else { return };
            let shift = Shift { reference: &self.reference, scale: &self.scale };
            watch.write_rows_from(before, &self.body, &self.pose, &mut self.problem, &shift, first);
            self.asked.0.clone_from(&self.problem.lower);
            self.asked.1.clone_from(&self.problem.upper);
            self.solve_once();
        }
    }

    /// Targets and limits of rows as they were before the last solve.
    fn ask_again(&mut self) {
        self.problem.lower.copy_from_slice(&self.asked.0);
        self.problem.upper.copy_from_slice(&self.asked.1);
    }

    fn solve_once(&mut self) {
        let outcome = solve(&mut self.problem, &mut self.work);
        self.stats.factorizations += u64::from(outcome.factorizations);
        self.stats.fallbacks += u64::from(outcome.fallback);
        self.stats.capped += u64::from(outcome.capped);
    }
}
