//! Tests of the crate by itself, without Python. Random cases are numbered: a failure names the seed that makes its case again.

#![allow(clippy::disallowed_methods)] // tests compare with the C library

#[cfg(feature = "count-allocations")]
mod allocations; // no frame after the first allocates
mod arcs; // between orientations, against turns about an axis
mod bodies; // bodies to try things on
mod cone; // distance of a vector from a cone
mod distances; // against closed forms, and proofs of optimality
mod hierarchy; // strict, optimal, never infeasible, the same bits
mod kernels; // the same bits for every processor
mod kinematics; // against finite differences and closed forms
mod random; // numbers from a seed
