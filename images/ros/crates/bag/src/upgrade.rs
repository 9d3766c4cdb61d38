//! Bags of format 1.2, rewritten as 2.0: no chunks, and a topic where 2.0 has a connection.

use std::collections::HashMap;

use crate::record::{Fields, FileRecord, OP_INDEX, OP_MESSAGE, read_bytes};
use crate::reindex::Reindexed;
use crate::{BagError, BagWriter, ChunkedFile, Connection, Loss, WriterOptions};

/// The line that every bag 1.2 begins with.
pub(crate) const OLD_MAGIC: &[u8; 13] = b"#ROSBAG V1.2\n";
const OP_DEFINITION: u8 = 1;

/// True for a bag of format 1.2.
pub(crate) fn is_old(file: &impl ChunkedFile) -> bool {
    read_bytes(file, 0, OLD_MAGIC.len() as u32, "the first line")
        .is_ok_and(|line| *line == OLD_MAGIC[..])
}

/// Topic, publisher, latching: what makes a connection of a message.
type Publisher = (String, Option<String>, bool);

struct Upgrade {
    writer: BagWriter,
    /// By topic, as the definition record says.
    definitions: HashMap<String, Connection>,
    ids: HashMap<Publisher, u32>,
}

/// Writes every whole message as a bag 2.0, in the file's order.
pub(crate) fn upgrade<F: ChunkedFile>(
    file: &F,
    options: WriterOptions,
) -> Result<Reindexed, BagError> {
    let writer = BagWriter::new(options);
    let mut upgrade = Upgrade { writer, definitions: HashMap::new(), ids: HashMap::new() };
    let mut at = FileRecord::read(file, OLD_MAGIC.len() as u64)?.end();
    let mut loss = None;
    while at < file.len() {
        match upgrade.record(file, at) {
            Ok(next) => at = next,
            Err(BagError::Damaged { offset, expected }) => {
                let bytes = file.len() - at;
                loss = Some(Loss { offset, bytes, messages: None, description: expected });
                break;
            }
            Err(error) => return Err(error),
        }
    }
    let messages = upgrade.writer.messages();
    Ok(Reindexed { bytes: upgrade.writer.finish()?, messages, whole_chunks: 0, loss })
}

impl Upgrade {
    /// Takes over one record; returns where the next begins.
    fn record<F: ChunkedFile>(&mut self, file: &F, at: u64) -> Result<u64, BagError> {
        let record = FileRecord::read(file, at)?;
        let fail = |defect| record.in_header(defect);
        let text = |name| {
            let value = Fields::require(&record.header, name).map_err(fail)?;
            Ok::<_, BagError>(String::from_utf8_lossy(value).into_owned())
        };
        match record.op {
            OP_DEFINITION => {
                let connection = Connection {
                    topic: text("topic")?,
                    datatype: text("type")?,
                    md5sum: text("md5")?,
                    definition: text("def")?,
                    ..Connection::default()
                };
                self.definitions.insert(connection.topic.clone(), connection);
            }
            OP_MESSAGE => {
                let seconds = Fields::require_u32(&record.header, "sec").map_err(fail)?;
                let nanos = Fields::require_u32(&record.header, "nsec").map_err(fail)?;
                let time = u64::from(seconds) * 1_000_000_000 + u64::from(nanos);
                let data = record.data(file)?;
                let caller = Fields::find(&record.header, "callerid").map_err(fail)?;
                let caller = caller.map(|name| String::from_utf8_lossy(name).into_owned());
                let latching = Fields::find(&record.header, "latching").map_err(fail)?;
                let publisher = (text("topic")?, caller, latching == Some(b"1"));
                let id = self.connection(publisher).ok_or_else(|| {
                    let expected = "a definition of the message's topic before it";
                    BagError::damaged(record.header_position, expected)
                })?;
                self.writer.write(id, time, &data)?;
            }
            OP_INDEX => {}
            op => {
                let expected = format!("a definition (1), message (2) or index (4), found op {op}");
                return Err(BagError::damaged(record.header_position, expected));
            }
        }
        Ok(record.end())
    }

    fn connection(&mut self, publisher: Publisher) -> Option<u32> {
        if let Some(id) = self.ids.get(&publisher) {
            return Some(*id);
        }
        let (_, caller_id, latching) = publisher.clone();
        let connection = self.definitions.get(&publisher.0)?.clone();
        let id = self.writer.add_connection(&Connection { caller_id, latching, ..connection });
        self.ids.insert(publisher, id);
        Some(id)
    }
}
