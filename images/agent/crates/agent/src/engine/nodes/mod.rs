//! A case of nodes, whatever their middleware: its input comes over the pipe, the user's command
//! is started, played into and recorded, and all that was started is ended.
//!
//! What differs between middlewares is a [`host::Host`].

pub(crate) mod case;
pub(crate) mod feed;
pub(crate) mod host;
pub(crate) mod outcome;
pub(crate) mod runner;
pub(crate) mod simulator;
