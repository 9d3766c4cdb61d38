//! A recording of one format as one of another.

use std::path::Path;

use bagpipe_log::{Recording, copy};
use bagpipe_mcap::{McapWriter, WriterOptions};
use bagpipe_rosbag::{Bag, ChunkedFile, WriterOptions as BagOptions};

use crate::{FormatError, Recordings, bag_of};

/// How chunks are compressed, by the names of all formats.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Packing {
    /// Not.
    None,
    /// LZ4.
    Lz4,
    /// bzip2, in bags alone.
    Bz2,
    /// Zstandard, in MCAP alone.
    Zstd,
}

impl Packing {
    /// The packing of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        match name {
            "none" => Some(Self::None),
            "lz4" => Some(Self::Lz4),
            "bz2" => Some(Self::Bz2),
            "zstd" => Some(Self::Zstd),
            _ => None,
        }
    }

    /// How a bag is written.
    ///
    /// # Errors
    /// [`FormatError::Refused`]: a bag knows no such compression.
    pub fn of_bag(self) -> Result<BagOptions, FormatError> {
        use bagpipe_rosbag::Compression::{Bz2, Lz4, None};
        let compression = match self {
            Self::None => None,
            Self::Lz4 => Lz4,
            Self::Bz2 => Bz2,
            Self::Zstd => return Err(refused("a bag has no zstd: choose none, lz4 or bz2")),
        };
        Ok(BagOptions::with_compression(compression))
    }

    /// How MCAP is written.
    ///
    /// # Errors
    /// [`FormatError::Refused`]: MCAP knows no such compression.
    pub fn of_mcap(self) -> Result<WriterOptions, FormatError> {
        use bagpipe_mcap::Compression::{Lz4, None, Zstd};
        let compression = match self {
            Self::None => None,
            Self::Lz4 => Lz4,
            Self::Zstd => Zstd,
            Self::Bz2 => return Err(refused("MCAP has no bz2: choose none, lz4 or zstd")),
        };
        Ok(WriterOptions::with_compression(compression))
    }
}

/// What is converted to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// A bag of ROS 1.
    Bag,
    /// An MCAP file.
    Mcap,
}

impl Target {
    /// The format that a file of this name has.
    ///
    /// # Errors
    /// [`FormatError::Refused`]: the name ends in neither `.bag` nor `.mcap`.
    pub fn of_name(name: &str) -> Result<Self, FormatError> {
        match Path::new(name).extension().and_then(std::ffi::OsStr::to_str) {
            Some("bag") => Ok(Self::Bag),
            Some("mcap") => Ok(Self::Mcap),
            _ => Err(refused("the name of what is written must end in .bag or .mcap")),
        }
    }
}

/// A recording that was converted.
#[derive(Debug)]
pub struct Converted {
    /// The file.
    pub bytes: Vec<u8>,
    /// Messages in it.
    pub messages: u64,
}

/// Another file of the same messages.
///
/// # Errors
/// [`FormatError::Refused`]: messages that a bag can't hold, or a compression that the format does
/// not know. Else as reading and writing.
pub fn converted(
    from: &Recordings,
    target: Target,
    packing: Packing,
) -> Result<Converted, FormatError> {
    let messages = from.message_count();
    let bytes = match (target, &from.files[..]) {
        (Target::Mcap, _) => from.rewritten(packing.of_mcap()?)?,
        (Target::Bag, [file]) => bag_of(file, None, packing.of_bag()?)?,
        (Target::Bag, _) => {
            let joined = Recordings::of_bytes(from.rewritten(WriterOptions::default())?, u64::MAX)?;
            let files = joined.files.first().ok_or_else(|| refused("it has no files"))?;
            bag_of(files, None, packing.of_bag()?)?
        }
    };
    Ok(Converted { bytes, messages })
}

/// A bag of ROS 1 as another file of the same messages.
///
/// # Errors
/// As [`converted`].
pub fn bag_into<F: ChunkedFile>(
    bag: &Bag<F>,
    target: Target,
    packing: Packing,
) -> Result<Converted, FormatError> {
    let bytes = match target {
        Target::Bag => bag_of(bag, None, packing.of_bag()?)?,
        Target::Mcap => {
            let profile = "ros1".to_owned();
            let mut writer = McapWriter::new(WriterOptions { profile, ..packing.of_mcap()? });
            copy(bag as &dyn Recording, &|_| true, &mut writer)?;
            writer.finish()?
        }
    };
    Ok(Converted { bytes, messages: bag.message_count() })
}

fn refused(sentence: &str) -> FormatError {
    FormatError::Refused(sentence.to_owned())
}
