//! Cyclone DDS, built by the machine's C compiler into an archive, for programs that are linked
//! statically.
//!
//! There is nothing for Rust in it. The build script of a crate that depends on this one finds in
//! its environment `DEP_BAGPIPE_CYCLONEDDS_ARCHIVE`, the archive, and
//! `DEP_BAGPIPE_CYCLONEDDS_INCLUDE`, folders of headers with colons between them. Whoever uses
//! the headers defines `NDEBUG`, as the archive was built: structures are longer without it.
//!
//! What is left out needs what a static program has not (plugins, names of hosts) or is of no use
//! on one machine (security, TCP, partitions of networks), or concerns types, of which the player
//! knows none.
