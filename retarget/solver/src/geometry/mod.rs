//! Simple solids and the distance between two of them: what observers and obstacles are made of.

mod shape;

pub use shape::{Shape, Solid};
