//! An index for a bag that has none, or a wrong one.

use crate::copy::Carrier;
use crate::upgrade::{is_old, upgrade};
use crate::{Bag, BagError, BagWriter, ChunkedFile, Loss, WriterOptions};

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
    if is_old(&file) {
        return upgrade(&file, options);
    }
    let bag = Bag::open_unindexed(file)?;
    let mut carrier = Carrier::new(&bag, BagWriter::new(options));
    for at in 0..bag.chunks.len() {
        if bag.chunks[at].messages() > 0 && !carrier.whole_with_new_index(at)? {
            carrier.messages(at, |_, _| true)?;
        }
    }
    let (messages, whole_chunks) = (carrier.writer.messages(), carrier.whole);
    let bytes = carrier.writer.finish()?;
    Ok(Reindexed { bytes, messages, whole_chunks, loss: bag.loss().cloned() })
}
