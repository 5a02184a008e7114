//! Stream filters: what is done with the poses of a performer's sensors between a decoder and the virtual human, a whole frame of
//! sensors in one call. They share nothing with the solver but its vectors and quaternions; they are native because they run in
//! every tick and on every frame that comes in (`docs/live.md`).
//!
//! In the order of the data:
//!
//! * `sensor_plan`: which poses of a sender make up each sensor, and poses that come in parts.
//! * `validity`: whether a pose may be used, and the state of every sensor.
//! * `playout`: poses of many capture times, read at one.
//! * `smooth`: arcs between orientations, and the One-Euro filter.
//! * `python`: what Python sees of them.
//!
//! Times are seconds of one clock, which the caller reads. NaN stands for what was not sent.

pub mod playout;
#[cfg(feature = "python")]
pub mod python;
pub mod sensor_plan;
pub mod smooth;
pub mod validity;
