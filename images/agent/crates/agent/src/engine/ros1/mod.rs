//! ROS 1: a master of its own for each case.

pub(crate) mod entry;
pub(crate) mod host;
pub(crate) mod met;
pub(crate) mod names;
pub(crate) mod parameters;
pub(crate) mod roll;
pub(crate) mod rosmaster;
