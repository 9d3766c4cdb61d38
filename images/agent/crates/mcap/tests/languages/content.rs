//! What each library writes, and in which forms.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

pub const MESSAGES: usize = 12;
/// Attachments and metadata stand before this message.
pub const BEFORE: usize = 5;
pub const PROFILE: &str = "ros2";
/// So that there are several chunks, and in the first, which declares everything, messages as well.
const CHUNK_BYTES: usize = 450;

/// How a file is written. Without `summary` there is nothing behind the data.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct Form {
    pub chunked: bool,
    pub compression: &'static str,
    pub index: bool,
    pub summary: bool,
    pub crc: bool,
    pub statistics: bool,
    pub repeat_channels: bool,
    pub repeat_schemas: bool,
    pub attachments: bool,
    pub metadata: bool,
    pub chunk_size: usize,
}

impl Form {
    /// Whether it is one of those that our writer has.
    pub fn is_ours(&self) -> bool {
        self.crc && self.statistics && self.is_planned()
    }

    /// Whether its summary has all that planning needs.
    pub fn is_planned(&self) -> bool {
        self.chunked && self.index && self.repeat_channels && self.repeat_schemas
    }
}

/// Each that differs from all others.
pub fn forms() -> Vec<Form> {
    let mut forms = Vec::new();
    let stored = [(false, "none", false)].into_iter().chain(
        ["none", "lz4", "zstd"]
            .into_iter()
            .flat_map(|each| [(true, each, false), (true, each, true)]),
    );
    for (chunked, compression, index) in stored {
        for bits in 0..64u8 {
            let [crc, attachments, metadata, statistics, repeat_channels, repeat_schemas] =
                [1, 2, 4, 8, 16, 32].map(|bit| bits & bit != 0);
            let form = Form {
                chunked,
                compression,
                index,
                summary: true,
                crc,
                statistics,
                repeat_channels,
                repeat_schemas,
                attachments,
                metadata,
                chunk_size: CHUNK_BYTES,
            };
            forms.push(form);
            if bits < 8 {
                forms.push(Form { summary: false, ..form });
            }
        }
    }
    forms
}

/// Name, encoding, data.
pub fn schemas() -> [(&'static str, &'static str, &'static [u8]); 2] {
    [
        ("std_msgs/msg/String", "ros2msg", b"string data\n"),
        ("lab.Reading", "protobuf", b"\x0a\xff\x00\x80 no text"),
    ]
}

/// Topic, encoding, place of its schema, metadata.
pub type Channel = (&'static str, &'static str, Option<usize>, BTreeMap<String, String>);

pub fn channels() -> [Channel; 4] {
    let qos = [("offered_qos_profiles", "- durability: 1\n"), ("topic_type_hash", "RIHS01_0")];
    let words = qos.map(|(key, word)| (key.to_owned(), word.to_owned()));
    [
        ("/a", "cdr", Some(0), BTreeMap::from(words)),
        ("/b", "protobuf", Some(1), BTreeMap::new()),
        ("/a", "cdr", Some(0), BTreeMap::new()),
        ("/loose", "json", None, BTreeMap::new()),
    ]
}

/// Place of the channel, log time, publish time, sequence, data: each second one was logged before
/// the first, and one has no data.
pub fn message(number: usize) -> (usize, u64, u64, u32, Vec<u8>) {
    let time = 1_700_000_000_000_000_000 + (number as u64 ^ 1) * 1_000_000;
    let published = if number % 5 == 3 { number as u64 } else { time - 500_000 };
    let data = (0..number * 9).map(|byte| (byte * 31 + number * 7) as u8).collect();
    (number % 4, time, published, number as u32 * 1000, data)
}

/// Log time, create time, name, media type, data.
pub fn attachments() -> [(u64, u64, &'static str, &'static str, &'static [u8]); 2] {
    [(5, 0, "camera.yaml", "text/yaml", b"focal: 500\n"), (u64::MAX, 7, "", "", b"\0\xff")]
}

pub fn metadata() -> (&'static str, BTreeMap<String, String>) {
    (
        "about",
        BTreeMap::from([("robot".to_owned(), "r2".to_owned()), (String::new(), "ä".to_owned())]),
    )
}

pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The work of the other languages' programs.
pub fn plan(forms: &[Form]) -> Value {
    let messages = (0..MESSAGES).map(|number| {
        let (channel, log, publish, sequence, data) = message(number);
        json!([channel, log.to_string(), publish.to_string(), sequence, hex(&data)])
    });
    let schemas = schemas().map(|(name, encoding, data)| json!([name, encoding, hex(data)]));
    let content = json!({
        "profile": PROFILE,
        "schemas": schemas,
        "channels": channels(),
        "messages": messages.collect::<Vec<_>>(),
        "before_message": BEFORE,
        "attachments": attachments().map(attachment),
        "metadata": [metadata()],
    });
    json!({"forms": forms, "content": content})
}

pub fn attachment((log, create, name, media_type, data): (u64, u64, &str, &str, &[u8])) -> Value {
    json!([log.to_string(), create.to_string(), name, media_type, hex(data)])
}

/// What a file of that form holds, its messages by time.
pub fn held(form: &Form) -> Value {
    let (channels, schemas) = (channels(), schemas());
    let mut messages: Vec<_> = (0..MESSAGES).map(message).collect();
    messages.sort_by_key(|each| each.1);
    let messages = messages.into_iter().map(|(channel, log, publish, sequence, data)| {
        let (topic, encoding, schema, words) = &channels[channel];
        let schema = schema.map(|at| schemas[at]);
        let schema = schema.map(|(name, encoding, data)| json!([name, encoding, hex(data)]));
        let (log, publish) = (log.to_string(), publish.to_string());
        json!([topic, encoding, schema, words, log, publish, sequence, hex(&data)])
    });
    let attachments =
        if form.attachments { attachments().map(attachment).to_vec() } else { vec![] };
    let metadata = if form.metadata { vec![metadata()] } else { vec![] };
    json!({
        "messages": messages.collect::<Vec<_>>(),
        "attachments": attachments,
        "metadata": metadata,
    })
}
