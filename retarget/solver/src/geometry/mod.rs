//! Simple solids and the distance between two of them: what observers and obstacles are made of.

mod nearest;
mod shape;

pub use nearest::{gap_at_least, nearest, Nearest, Scratch};
pub use shape::{Shape, Solid};
