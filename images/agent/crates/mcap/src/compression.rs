//! The three ways in which a chunk's records may lie in a file.

use std::cell::RefCell;
use std::io::{self, Read};

use bagpipe_packing::{Packing, lz4};
use zstd::bulk;

/// How a chunk is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Compression {
    /// As it is: read without a copy.
    #[default]
    None,
    /// LZ4 frame: fast.
    Lz4,
    /// Zstandard at its fastest level: smaller.
    Zstd,
}

/// The first allocation for a chunk whose size is only claimed; it then grows with what really
/// comes out, so that a chunk that only claims to be large costs nothing.
const FIRST_ALLOCATION: usize = 1 << 20;
/// Data that grows more than so many times is unusual, and believed as it comes out.
const USUAL_GROWTH: usize = 64;
/// The window that a decoder of a stream may ask memory for (8 MiB): as much as every decoder
/// must take, by the format's own advice.
const MOST_WINDOW_LOG: u32 = 23;
/// What rosbag2 calls fastest; level 3 takes twice as long for a tenth less.
const ZSTD_LEVEL: i32 = 1;

thread_local! {
    /// Their tables take longer to make than a small chunk takes to go through them.
    static COMPRESSOR: RefCell<Option<bulk::Compressor<'static>>> = const { RefCell::new(None) };
    static DECOMPRESSOR: RefCell<Option<bulk::Decompressor<'static>>> =
        const { RefCell::new(None) };
}

impl Compression {
    /// The name in a Chunk record.
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "",
            Self::Lz4 => "lz4",
            Self::Zstd => "zstd",
        }
    }

    /// The compression of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::None, Self::Lz4, Self::Zstd].into_iter().find(|each| each.name() == name)
    }

    /// Uncompresses at most `size` bytes and one in place of what `bytes` holds; what came out of
    /// data that is cut stays there. Says what was wrong.
    pub(crate) fn decompress(self, data: &[u8], size: u32, bytes: &mut Vec<u8>) -> Option<String> {
        let whole = match self {
            Self::None => None,
            Self::Lz4 => lz4::whole_into(data, size, bytes),
            Self::Zstd => whole_zstd(data, size, bytes),
        };
        let failed = match (whole, self) {
            (Some(()), _) => None,
            (None, Self::Lz4) => drain(lz4_flex::frame::FrameDecoder::new(data), size, bytes),
            (None, Self::Zstd) => stream_zstd(data, size, bytes),
            (None, Self::None) => drain(data, size, bytes),
        };
        match failed {
            Some(error) => Some(format!("whole {} data of {size} bytes ({error})", self.name())),
            None if bytes.len() != size as usize => {
                Some(format!("{} data of {size} bytes, found {}", self.name(), bytes.len()))
            }
            None => None,
        }
    }
}

/// The bytes of whole and usual data, straight into their place.
fn whole_zstd(data: &[u8], size: u32, bytes: &mut Vec<u8>) -> Option<()> {
    if size as usize > data.len().saturating_mul(USUAL_GROWTH) {
        return None;
    }
    DECOMPRESSOR.with_borrow_mut(|kept| {
        let decompressor = match kept {
            Some(decompressor) => decompressor,
            None => kept.insert(bulk::Decompressor::new().ok()?),
        };
        bytes.clear();
        bytes.reserve_exact(size as usize);
        decompressor.decompress_to_buffer(data, bytes).ok()?;
        (bytes.len() == size as usize).then_some(())
    })
}

fn stream_zstd(data: &[u8], size: u32, bytes: &mut Vec<u8>) -> Option<io::Error> {
    let decoder = zstd::stream::read::Decoder::with_buffer(data).and_then(|mut decoder| {
        decoder.window_log_max(MOST_WINDOW_LOG)?;
        Ok(decoder)
    });
    match decoder {
        Ok(decoder) => drain(decoder, size, bytes),
        Err(error) => {
            bytes.clear();
            Some(error)
        }
    }
}

/// Reads to the end, or one byte past `size`, which shows that there is too much.
fn drain(reader: impl Read, size: u32, bytes: &mut Vec<u8>) -> Option<io::Error> {
    bytes.clear();
    bytes.reserve(FIRST_ALLOCATION.min(size as usize));
    let failed = reader.take(u64::from(size) + 1).read_to_end(bytes).err();
    // Checksums stand behind what they are of: where one is wrong, no one knows what came out wrong.
    if failed.as_ref().is_some_and(|error| error.kind() != io::ErrorKind::UnexpectedEof) {
        bytes.clear();
    }
    failed
}

impl Packing for Compression {
    fn compress(self, data: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
        match self {
            Self::None => {
                out.clear();
                out.extend_from_slice(data);
                Ok(data.len())
            }
            Self::Lz4 => lz4::frame_into(data, out),
            Self::Zstd => zstd_into(data, out),
        }
    }
}

fn zstd_into(data: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
    let most = zstd::zstd_safe::compress_bound(data.len());
    if out.len() < most {
        out.resize(most, 0);
    }
    COMPRESSOR.with_borrow_mut(|kept| {
        let compressor = match kept {
            Some(compressor) => compressor,
            None => kept.insert(bulk::Compressor::new(ZSTD_LEVEL)?),
        };
        compressor.compress_to_buffer(data, out.as_mut_slice())
    })
}
