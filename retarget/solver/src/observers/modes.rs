//! What an observer is doing.

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
