//! What people start by hand: verbs for bags, and for a graph that runs.

pub(crate) mod bagfile;
pub(crate) mod check;
pub(crate) mod convert;
pub(crate) mod delivery_table;
pub(crate) mod graph_options;
pub(crate) mod hello;
pub(crate) mod info;
pub(crate) mod install;
pub(crate) mod merge;
pub(crate) mod play;
pub(crate) mod record;
pub(crate) mod reindex;
pub(crate) mod slice;
