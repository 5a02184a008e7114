//! Tests of the crate by itself, without Python. Random cases are numbered: a failure names the seed that makes its case again.

#![allow(clippy::disallowed_methods)] // tests compare with the C library

#[cfg(feature = "count-allocations")]
mod allocations; // no frame after the first allocates
mod arcs; // between orientations, against turns about an axis
#[cfg(feature = "count-allocations")]
mod bodies; // bodies to try things on
mod hierarchy; // strict, never infeasible, the same bits
mod kernels; // the same bits for every processor
mod random; // numbers from a seed
