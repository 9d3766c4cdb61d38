//! The three ways in which a chunk's data may lie in a bag.

use std::io::{self, Read, Write};

use bagpipe_packing::{Packing, lz4};

/// How a chunk is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Compression {
    /// As it is: read without a copy.
    #[default]
    None,
    /// bzip2: small and slow.
    Bz2,
    /// LZ4 frame: fast.
    Lz4,
}

/// The first allocation for a chunk; it then grows with what really comes out, so that a
/// chunk that only claims to be large costs nothing.
const FIRST_ALLOCATION: usize = 1 << 20;

impl Compression {
    /// The name in a CHUNK record's header.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Bz2 => "bz2",
            Self::Lz4 => "lz4",
        }
    }

    /// The compression of that name.
    pub fn from_name(name: &[u8]) -> Option<Self> {
        [Self::None, Self::Bz2, Self::Lz4].into_iter().find(|each| each.name().as_bytes() == name)
    }

    /// Uncompresses at most `size` bytes, and says what was wrong; what came out of data that is
    /// cut is kept beside it.
    pub(crate) fn decompress(self, data: &[u8], size: u32) -> (Vec<u8>, Option<String>) {
        let (bytes, failed) = match self {
            Self::None => (data.to_vec(), None),
            Self::Bz2 => drain(bzip2::read::BzDecoder::new(data), size),
            Self::Lz4 => match lz4::whole(data, size) {
                Some(bytes) => (bytes, None),
                None => drain(lz4_flex::frame::FrameDecoder::new(data), size),
            },
        };
        let wrong = match failed {
            Some(error) => Some(format!("whole {} data of {size} bytes ({error})", self.name())),
            None if bytes.len() != size as usize => {
                Some(format!("{} data of {size} bytes, found {}", self.name(), bytes.len()))
            }
            None => None,
        };
        (bytes, wrong)
    }
}

impl Packing for Compression {
    fn compress(self, data: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
        match self {
            Self::None => {
                out.clear();
                out.extend_from_slice(data);
                Ok(data.len())
            }
            Self::Bz2 => {
                out.clear();
                // Level 9 is what rosbag writes.
                let mut encoder = bzip2::write::BzEncoder::new(out, bzip2::Compression::best());
                encoder.write_all(data)?;
                Ok(encoder.finish()?.len())
            }
            Self::Lz4 => lz4::frame_into(data, out),
        }
    }
}

/// Reads to the end, or one byte past `size`, which shows that there is too much.
fn drain(reader: impl Read, size: u32) -> (Vec<u8>, Option<io::Error>) {
    let mut bytes = Vec::with_capacity(FIRST_ALLOCATION.min(size as usize));
    let failed = reader.take(u64::from(size) + 1).read_to_end(&mut bytes).err();
    // Checksums stand behind what they are of: where one is wrong, no one knows what came out wrong.
    if failed.as_ref().is_some_and(|error| error.kind() != io::ErrorKind::UnexpectedEof) {
        bytes.clear();
    }
    (bytes, failed)
}
