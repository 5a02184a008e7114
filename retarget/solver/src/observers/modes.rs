//! What an observer is doing, and how often that changes.

/// Deeper than this (m) is contact: rounding is not.
pub const CONTACT: f64 = 1e-4;
/// A pair leaves influence a little farther out than it came in, so that rest at the edge is no coming and going.
const LEAVING: f64 = 1.05;

#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Debug, Default)]
pub enum Mode {
    #[default]
    Free,
    Preventive,
    Reactive,
}

impl Mode {
    /// What a pair does next at this distance.
    pub fn next(self, distance: f64, influence: f64) -> Self {
        let touches = distance < if self == Self::Reactive { -0.5 * CONTACT } else { -CONTACT };
        let is_near = distance < if self == Self::Free { influence } else { LEAVING * influence };
        match (touches, is_near) {
            (true, _) => Self::Reactive,
            (_, true) => Self::Preventive,
            _ => Self::Free,
        }
    }
}

/// Modes of observers from frame to frame.
#[derive(Clone, Debug)]
pub struct Tally {
    /// Of the frame that runs, and of the last one.
    now: Vec<Mode>,
    pub last: Vec<Mode>,
    /// Frames that ended in another mode than the one before, and frames spent in each mode that acts, per observer.
    pub switches: Vec<u64>,
    pub preventive: Vec<u64>,
    pub reactive: Vec<u64>,
}

impl Tally {
    pub fn new(observers: usize) -> Self {
        Self {
            now: vec![Mode::Free; observers],
            last: vec![Mode::Free; observers],
            switches: vec![0; observers],
            preventive: vec![0; observers],
            reactive: vec![0; observers],
        }
    }

    /// Forget the modes, not the counts.
    pub fn restart(&mut self) {
        self.last.fill(Mode::Free);
        self.now.fill(Mode::Free);
    }

    pub fn note(&mut self, observer: usize, mode: Mode) {
        self.now[observer] = self.now[observer].max(mode);
    }

    pub fn end_frame(&mut self) {
        for k in 0..self.now.len() {
            let mode = self.now[k];
            self.switches[k] += u64::from(mode != self.last[k]);
            self.preventive[k] += u64::from(mode == Mode::Preventive);
            self.reactive[k] += u64::from(mode == Mode::Reactive);
            self.last[k] = mode;
            self.now[k] = Mode::Free;
        }
    }
}
