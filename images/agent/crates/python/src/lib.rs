//! The agent's bag for Python: `bagpipe.MemoryBag`, and what a planner needs of bags.
//!
//! Thin: each file gives one thing of the crates of recordings to Python. What takes long runs
//! without Python's lock; what Python gets of messages are views of the bag's own memory, and
//! [`view`] is the only file with `unsafe`, which the buffer protocol demands.

mod bag;
mod definition;
mod error;
mod from_mcap;
mod mcap;
mod mcap_writer;
mod memory;
mod messages;
mod model;
mod pictures;
mod recordings;
mod rosbag2;
mod tail;
mod view;
mod writer;

use pyo3::prelude::*;

/// Native part of `bagpipe`; use `bagpipe.MemoryBag`.
#[pymodule]
mod bagpipe_bag {
    #[pymodule_export]
    use crate::bag::MemoryBag;
    #[pymodule_export]
    use crate::definition::different_field;
    #[pymodule_export]
    use crate::error::BagError;
    #[pymodule_export]
    use crate::mcap::{McapMessages, MemoryMcap};
    #[pymodule_export]
    use crate::mcap_writer::MemoryMcapWriter;
    #[pymodule_export]
    use crate::messages::Messages;
    #[pymodule_export]
    use crate::model::{Checked, Connection, Damage};
    #[pymodule_export]
    use crate::pictures::jpeg_pixels;
    #[pymodule_export]
    use crate::recordings::{
        check_recording, convert_recording, describe_recording, mend_recording, merge_recordings,
        recording_kind, slice_recording,
    };
    #[pymodule_export]
    use crate::rosbag2::{database_rows, joined_mcap, rosbag2_metadata, uncompress_file};
    #[pymodule_export]
    use crate::tail::{
        TailError, bag_index, chunk_compression, chunk_length, connection_fields, index_times,
        mcap_footer, mcap_head, mcap_index, mcap_index_times, parse_head, split_record,
    };
    #[pymodule_export]
    use crate::writer::MemoryBagWriter;
}
