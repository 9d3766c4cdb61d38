//! LZ4 frames as chunks hold them, uncompressed straight into their place: one block after
//! the other, without the decoder's own buffers. Whatever is unusual or damaged is left to
//! the general decoder, which also keeps what came out before the damage. Written the same
//! way, into a buffer that is used again.

use std::io;

const MAGIC: u32 = 0x184d_2204;
/// Set in a block's size when the block is stored as it is.
const STORED: u32 = 1 << 31;
/// No LZ4 block grows more than this many times: a larger claim is not believed.
const MOST_GROWTH: usize = 255;
const VERSION_MASK: u8 = 0b1100_0000;
/// How far back a block may refer to those before it.
const REACH: usize = 64 << 10;
const VERSION: u8 = 0b0100_0000;
const INDEPENDENT: u8 = 0b0010_0000;
const BLOCK_CHECKSUM: u8 = 0b0001_0000;
const CONTENT_SIZE: u8 = 0b0000_1000;
const CONTENT_CHECKSUM: u8 = 0b0000_0100;

/// What a frame must begin with for roslz4, which the original and Debian's tools read LZ4 by:
/// independent blocks, a checksum over the content, and no other option. It calls all else
/// damaged, also what `rosbags` writes.
pub const ROS_HEAD: usize = 5;

/// Whether a frame that begins so is one that roslz4 reads.
pub fn is_ros(head: &[u8]) -> bool {
    u32_at(head, 0) == Some(MAGIC) && head.get(4) == Some(&WRITTEN)
}

/// The `size` bytes of a whole and undamaged frame; `None` leaves it to the general decoder.
pub fn whole(frame: &[u8], size: u32) -> Option<Vec<u8>> {
    let mut bytes = Vec::new();
    whole_into(frame, size, &mut bytes)?;
    Some(bytes)
}

/// [`whole`] in place of what `bytes` holds, which is anything after a `None`. Memory that was
/// written to before is several times faster than fresh memory.
pub fn whole_into(frame: &[u8], size: u32, bytes: &mut Vec<u8>) -> Option<()> {
    let size = size as usize;
    if size > frame.len().checked_mul(MOST_GROWTH)? || u32_at(frame, 0)? != MAGIC {
        return None;
    }
    let flags = *frame.get(4)?;
    if flags & (VERSION_MASK | BLOCK_CHECKSUM | 0b11) != VERSION {
        return None;
    }
    let reach = if flags & INDEPENDENT == 0 { REACH } else { 0 };
    let header = if flags & CONTENT_SIZE == 0 { 2 } else { 10 };
    let descriptor = frame.get(4..4 + header)?;
    if *frame.get(4 + header)? != (hash(descriptor) >> 8) as u8 {
        return None;
    }
    let mut at = 4 + header + 1;
    if bytes.capacity() < size {
        // What the system has cleared needs not be cleared again.
        *bytes = vec![0; size];
    }
    bytes.resize(size, 0);
    let mut filled = 0;
    loop {
        let word = u32_at(frame, at)?;
        at += 4;
        if word == 0 {
            break;
        }
        let block = frame.get(at..at.checked_add((word & !STORED) as usize)?)?;
        at += block.len();
        let (done, room) = bytes.split_at_mut_checked(filled)?;
        if word & STORED != 0 {
            room.get_mut(..block.len())?.copy_from_slice(block);
            filled += block.len();
        } else {
            let known = &done[filled.saturating_sub(reach)..];
            filled += lz4_flex::block::decompress_into_with_dict(block, room, known).ok()?;
        }
    }
    let checked = flags & CONTENT_CHECKSUM == 0 || u32_at(frame, at)? == hash(bytes);
    (checked && filled == size).then_some(())
}

/// roslz4 reads only independent blocks behind a content checksum, and wants no more.
const WRITTEN: u8 = VERSION | INDEPENDENT | CONTENT_CHECKSUM;
/// Blocks of at most 1 MiB.
const WRITTEN_BLOCKS: u8 = 6 << 4;
const BLOCK: usize = 1 << 20;

/// Magic, flags, largest block, and their checksum.
const HEADER: usize = 7;

/// Writes `data` as a frame into the first bytes of `out`, which grows where it must, and
/// returns how many these are.
///
/// # Errors
/// The compressor found too little room, which it never does.
pub fn frame_into(data: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
    // A block is stored where it would grow: only one at a time needs more room than it has.
    let sizes = 4 * data.len().div_ceil(BLOCK);
    let most = HEADER + sizes + lz4_flex::block::get_maximum_output_size(data.len()) + 8;
    if out.len() < most {
        out.resize(most, 0);
    }
    let descriptor = [WRITTEN, WRITTEN_BLOCKS];
    out[..4].copy_from_slice(&MAGIC.to_le_bytes());
    out[4..6].copy_from_slice(&descriptor);
    out[6] = (hash(&descriptor) >> 8) as u8;
    let mut at = HEADER;
    for block in data.chunks(BLOCK) {
        let room = &mut out[at + 4..];
        let length = lz4_flex::block::compress_into(block, room).map_err(io::Error::other)?;
        let word = if length < block.len() {
            length as u32
        } else {
            room[..block.len()].copy_from_slice(block);
            block.len() as u32 | STORED
        };
        out[at..at + 4].copy_from_slice(&word.to_le_bytes());
        at += 4 + (word & !STORED) as usize;
    }
    out[at..at + 4].copy_from_slice(&0u32.to_le_bytes());
    out[at + 4..at + 8].copy_from_slice(&hash(data).to_le_bytes());
    Ok(at + 8)
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let word = bytes.get(at..)?.first_chunk()?;
    Some(u32::from_le_bytes(*word))
}

fn hash(bytes: &[u8]) -> u32 {
    twox_hash::XxHash32::oneshot(0, bytes)
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use lz4_flex::frame::{BlockMode, BlockSize, FrameDecoder, FrameEncoder, FrameInfo};

    fn frame(bytes: &[u8]) -> Vec<u8> {
        let mut frame = vec![9; 10];
        let used = super::frame_into(bytes, &mut frame).unwrap();
        frame.truncate(used);
        frame
    }

    /// Compressible, then not: stored blocks as well.
    fn mixed() -> Vec<u8> {
        let mut state = 7u32;
        let noise = std::iter::repeat_with(|| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        std::iter::repeat_n(5, 1_500_000).chain(noise.take(1_500_000)).collect()
    }

    #[test]
    fn other_decoders_read_what_is_written() {
        let bytes = mixed();
        for length in [0, 1, 100, 1 << 20, (1 << 20) + 1, bytes.len()] {
            let frame = frame(&bytes[..length]);
            let mut back = Vec::new();
            FrameDecoder::new(&frame[..]).read_to_end(&mut back).unwrap();
            assert!(back == bytes[..length], "{length} bytes");
            assert_eq!(super::whole(&frame, length as u32), Some(back));
        }
    }

    #[test]
    fn blocks_that_refer_to_those_before_them_come_out_in_place() {
        // 5,000 bytes that can't be compressed, which blocks of their own would each begin with.
        let bytes = mixed()[1_500_000..1_505_000].repeat(200);
        let frames = [BlockMode::Linked, BlockMode::Independent].map(|mode| {
            let info = FrameInfo::new().block_mode(mode).block_size(BlockSize::Max64KB);
            let mut encoder = FrameEncoder::with_frame_info(info, Vec::new());
            encoder.write_all(&bytes).unwrap();
            encoder.finish().unwrap()
        });
        let lengths = frames.each_ref().map(Vec::len);
        assert!(lengths[0] + 10_000 < lengths[1], "the blocks refer to nothing: {lengths:?}");
        for frame in frames {
            assert_eq!(super::whole(&frame, bytes.len() as u32).as_ref(), Some(&bytes));
        }
    }

    #[test]
    fn whole_frames_come_out_and_others_are_left() {
        let bytes: Vec<u8> = (0..3_000_000u32).map(|at| (at >> 7) as u8 ^ at as u8).collect();
        let frame = frame(&bytes);
        assert_eq!(super::whole(&frame, 3_000_000), Some(bytes));
        for wrong in [2_999_999, 3_000_001, u32::MAX, 0] {
            assert_eq!(super::whole(&frame, wrong), None, "{wrong}");
        }
        for at in [0, 4, 5, 6, 9, 1000, frame.len() - 1] {
            let mut damaged = frame.clone();
            damaged[at] ^= 0x40;
            assert_eq!(super::whole(&damaged, 3_000_000), None, "byte {at}");
        }
        for cut in [0, 3, 6, 10, 2000, frame.len() - 1] {
            assert_eq!(super::whole(&frame[..cut], 3_000_000), None, "cut at {cut}");
        }
    }
}
