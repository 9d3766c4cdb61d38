//! What runs a case's stack, one folder for each engine.

pub(crate) mod exec;
pub(crate) mod ros1;
