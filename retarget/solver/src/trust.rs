//! How far each level's linear model is trusted: damping grows where steps do not do what they promised.
//!
//! Far from its goal, near a stretched limb, the linear model of a task holds only for small steps; undamped steps overshoot and shake.
//! As in Levenberg-Marquardt, the decrease of a level's error that a step promised is compared with the one that it brought.

/// Damping of a level that begins to be distrusted (m/rad).
const FIRST: f64 = 0.02;
/// Damping below this is none.
const LEAST: f64 = 0.005;
/// A promise smaller than this (squared error) is not judged.
const LITTLE: f64 = 1e-8;
/// Trust comes back only near the goal (squared error): far from it, a kept promise says only that the steps have become small.
const NEAR: f64 = 2.5e-3;

#[derive(Clone, Debug, Default)]
struct Level {
    damping: f64,
    before: f64,
    promised: f64,
    open: bool,
}

#[derive(Clone, Debug, Default)]
pub struct Trust {
    levels: Vec<Level>,
    /// Largest damping; 0 switches all damping off.
    most: f64,
}

impl Trust {
    pub fn new(levels: usize, most: f64) -> Self {
        Self { levels: vec![Level::default(); levels], most }
    }

    pub fn reset(&mut self) {
        self.levels.fill(Level::default());
    }

    pub fn damping(&self, level: usize) -> f64 {
        self.levels[level].damping
    }

    /// A step was taken: squared error of the level before it, and what the linear model promises after it.
    pub fn promise(&mut self, level: usize, before: f64, after: f64) {
        let l = &mut self.levels[level];
        (l.before, l.promised, l.open) = (before, after, true);
    }

    /// What the step brought: the squared error now, with the same goal.
    pub fn judge(&mut self, level: usize, now: f64) {
        let most = self.most;
        if most == 0.0 {
            return;
        }
        let l = &mut self.levels[level];
        let promised = l.before - l.promised;
        if l.open && promised > LITTLE {
            let kept = (l.before - now) / promised;
            if kept < 0.25 {
                l.damping = (2.0 * l.damping).max(FIRST).min(most);
            }
        }
        if now < NEAR {
            l.damping *= 0.9;
            if l.damping < LEAST {
                l.damping = 0.0;
            }
        }
        l.open = false;
    }
}
