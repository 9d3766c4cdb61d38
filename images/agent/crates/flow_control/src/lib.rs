//! Flow control for datagrams within one machine, in C, for programs that are built by other crates.
//!
//! There is nothing for Rust in it. The build script of a crate that depends on this one finds in
//! its environment `DEP_BAGPIPE_FLOW_CONTROL_FOLDER`, with `flow_control.c` and `flow_control.h`.
//! The player has it for what it plays, and the ledger's library for what the stack's nodes publish.
