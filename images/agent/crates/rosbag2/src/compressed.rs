//! Zstandard frames, within a bound.

use std::io::{Read, Write};

use crate::Rosbag2Error;

/// The window that a file may ask memory for (128 MiB): as much as zstd's own program takes.
const FILE_WINDOW_LOG: u32 = 27;
/// The same of a message (8 MiB), which every decoder must take by the format's own advice.
const MESSAGE_WINDOW_LOG: u32 = 23;

/// Uncompresses a file that was compressed as a whole, and returns how long it is.
///
/// # Errors
/// [`Rosbag2Error::MemoryLimit`] behind `most` bytes, [`Rosbag2Error::Compressed`],
/// [`Rosbag2Error::System`] where `to` takes no more.
pub fn uncompress(from: impl Read, to: &mut impl Write, most: u64) -> Result<u64, Rosbag2Error> {
    let mut decoder = zstd::stream::read::Decoder::new(from)?;
    decoder.window_log_max(FILE_WINDOW_LOG)?;
    let mut piece = vec![0; 1 << 17];
    let mut length = 0u64;
    loop {
        let read = match decoder.read(&mut piece) {
            Ok(0) => return Ok(length),
            Ok(read) => read,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => continue,
            Err(error) => {
                let what = format!("the compressed file, at byte {length} of what is in it");
                let expected = format!("whole zstd data ({error})");
                return Err(Rosbag2Error::Compressed { what, expected });
            }
        };
        length += read as u64;
        if length > most {
            let what = "what is in the compressed file".to_owned();
            return Err(Rosbag2Error::MemoryLimit { what, allowed: most });
        }
        to.write_all(&piece[..read])?;
    }
}

/// Uncompresses a message that was compressed alone, in place of what `bytes` holds; `what`
/// names it.
pub(crate) fn message(
    data: &[u8],
    most: u64,
    bytes: &mut Vec<u8>,
    what: impl Fn() -> String,
) -> Result<(), Rosbag2Error> {
    bytes.clear();
    let wrong = |error: std::io::Error| Rosbag2Error::Compressed {
        what: what(),
        expected: format!("a message as whole zstd data ({error})"),
    };
    let mut decoder = zstd::stream::read::Decoder::with_buffer(data).map_err(wrong)?;
    decoder.window_log_max(MESSAGE_WINDOW_LOG).map_err(wrong)?;
    decoder.take(most.saturating_add(1)).read_to_end(bytes).map_err(wrong)?;
    if bytes.len() as u64 > most {
        return Err(Rosbag2Error::MemoryLimit { what: what(), allowed: most });
    }
    Ok(())
}
