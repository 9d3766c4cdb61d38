//! An index for a bag that has none, or a wrong one.

use crate::copy::Carrier;
use crate::{Bag, BagError, BagWriter, ChunkedFile, Limits, Loss, WriterOptions};

/// Room for a file header and the records of a small chunk.
const LEAST_BAG: u64 = 64 << 10;

/// A bag with a new index, and what could not be saved.
#[derive(Debug)]
pub struct Reindexed {
    /// The bag.
    pub bytes: Vec<u8>,
    /// Messages in it.
    pub messages: u64,
    /// Chunks that were carried as they are; the others were damaged, or name connections
    /// that nothing before them declares.
    pub whole_chunks: usize,
    /// What the old bag had lost.
    pub loss: Option<Loss>,
}

/// Reads every record from the front and writes the whole messages with an index. Whole
/// chunks keep their bytes; messages of damaged ones are written anew, compressed as
/// `options` say. A bag of format 1.2 becomes one of format 2.0.
pub fn reindex<F: ChunkedFile>(file: F, options: WriterOptions) -> Result<Reindexed, BagError> {
    reindex_limited(file, options, Limits::default())
}

/// [`reindex`] with bounded memory: the limit holds for what is uncompressed to be read, and
/// again for how much larger than the old bag the new one may become.
pub fn reindex_limited<F: ChunkedFile>(
    file: F,
    mut options: WriterOptions,
    limits: Limits,
) -> Result<Reindexed, BagError> {
    let bag = Bag::open_unindexed_limited(file, limits)?;
    // An index entry is no longer than the header of its message.
    let largest = bag.file.len().saturating_mul(2).saturating_add(limits.decompressed_bytes);
    let budget = largest.saturating_add(LEAST_BAG);
    options.byte_budget = Some(options.byte_budget.map_or(budget, |own| own.min(budget)));
    // In a buffer of our own, because a budget is reserved otherwise.
    let writer = BagWriter::with_buffer(options, Vec::new());
    let mut carrier = Carrier::new(&bag, writer);
    for at in 0..bag.chunks.len() {
        if bag.chunks[at].messages() > 0 && !carrier.whole_with_new_index(at)? {
            carrier.messages(at, |_, _| true)?;
        }
    }
    let (messages, whole_chunks) = (carrier.writer.messages(), carrier.whole);
    let bytes = carrier.writer.finish()?;
    Ok(Reindexed { bytes, messages, whole_chunks, loss: bag.loss().cloned() })
}
