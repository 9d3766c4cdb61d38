//! Writes the seed corpus, each input by our own code: small bags and MCAP files of each format
//! and compression, whole and cut; chunks; the pipe's test vectors and maps; what nodes and
//! masters say. `cargo run --bin seeds -- corpus`.

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};

use bagpipe_rosbag::fuzzing::pack;
use bagpipe_rosbag::{BagWriter, Compression, Connection, WriterOptions};
use bagpipe_wire::{Abort, AgentHello, End, FileHeader, Metric, WorkerHello, to_map};
use bagpipe_ros1::Value;
use bagpipe_ros1::fuzzing::{write_answer, write_call, write_header};

type Outcome = Result<(), Box<dyn Error>>;

/// Writes inputs of one target.
struct Folder(PathBuf);

impl Folder {
    fn new(root: &Path, target: &str) -> std::io::Result<Self> {
        let folder = root.join(target);
        fs::create_dir_all(&folder)?;
        Ok(Self(folder))
    }

    /// The input, and its first half.
    fn add(&self, name: &str, bytes: &[u8]) -> std::io::Result<()> {
        fs::write(self.0.join(format!("{name}-cut")), &bytes[..bytes.len() / 2])?;
        fs::write(self.0.join(name), bytes)
    }
}

fn main() -> Outcome {
    let root = std::env::args().nth(1).unwrap_or_else(|| "corpus".to_owned());
    let root = Path::new(&root);
    for target in ["open", "scan", "parts", "tail"] {
        let folder = Folder::new(root, target)?;
        for compression in [Compression::None, Compression::Lz4, Compression::Bz2] {
            for messages in [0, 1, 8] {
                folder.add(
                    &format!("{}-{messages}", compression.name()),
                    &bag(compression, messages)?,
                )?;
            }
        }
        folder.add("format-1.2", &[b"#ROSBAG V1.2\n", &old_bag(8)[..]].concat())?;
    }
    let old = Folder::new(root, "old")?;
    for messages in [0, 1, 8] {
        old.add(&format!("old-{messages}"), &old_bag(messages))?;
    }
    mcap(&Folder::new(root, "mcap")?)?;
    rosbag2(&Folder::new(root, "rosbag2")?)?;
    chunks(&Folder::new(root, "chunks")?)?;
    frames(&Folder::new(root, "frames")?)?;
    greetings(&Folder::new(root, "greetings")?)?;
    headers(&Folder::new(root, "headers")?)?;
    messages(&Folder::new(root, "messages")?)?;
    http(&Folder::new(root, "http")?)?;
    pictures(&Folder::new(root, "pictures")?)?;
    xmlrpc(&Folder::new(root, "xmlrpc")?)
}

/// Two halves of 16 pixels by 16, as JPEG.
fn pictures(folder: &Folder) -> Outcome {
    folder.add("baseline", include_bytes!("seeds/baseline.jpg"))?;
    folder.add("progressive", include_bytes!("seeds/progressive.jpg"))?;
    Ok(())
}

fn bag(compression: Compression, messages: u64) -> Result<Vec<u8>, Box<dyn Error>> {
    let options = WriterOptions { compression, chunk_threshold: 300, byte_budget: None };
    let mut writer = BagWriter::new(options);
    for (topic, latching) in [("/a", false), ("/map", true)] {
        writer.add_connection(&Connection {
            topic: topic.to_owned(),
            datatype: "std_msgs/String".to_owned(),
            md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".into(),
            latching,
            ..Connection::default()
        });
    }
    for number in 0..messages {
        writer.write((number % 2) as u32, number * 5_000_000, &[number as u8; 90])?;
    }
    Ok(writer.finish()?)
}

fn mcap(folder: &Folder) -> Outcome {
    use bagpipe_mcap::{Attachment, Compression, McapWriter, Metadata, WriterOptions};
    for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
        for messages in [0, 1, 8] {
            let options = WriterOptions::with_compression(compression);
            let mut writer = McapWriter::new(WriterOptions { chunk_threshold: 300, ..options });
            let connection = Connection { topic: "/a".to_owned(), ..Connection::default() };
            let id = writer.add_connection(&connection);
            let entries = [("key".to_owned(), "value".to_owned())].into();
            writer.describe(&Metadata { name: "about".to_owned(), entries })?;
            let (log_time, create_time, name, media_type) = (1, 2, "notes", "text/plain");
            let data = b"hello";
            writer.attach(&Attachment { log_time, create_time, name, media_type, data })?;
            for number in 0..messages {
                writer.write(id, number * 5_000_000, &[number as u8; 90])?;
            }
            folder.add(&format!("{}-{messages}", compression.name()), &writer.finish()?)?;
        }
    }
    Ok(())
}

const QOS: &str = "- history: 3\n  depth: 0\n  durability: 1";
/// As rosbag2 makes them.
const TABLES: &str = "
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
  timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
  encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
INSERT INTO message_definitions VALUES (1, 'std_msgs/msg/String', 'ros2msg', 'string data', '');";

/// Folders of one file in each storage and compression: the metadata behind its length, the file.
fn rosbag2(folder: &Folder) -> Outcome {
    for (version, storage) in [(4, "sqlite3"), (6, "mcap"), (9, "sqlite3"), (9, "mcap")] {
        for mode in ["", "FILE", "MESSAGE"] {
            let packed = |data: &[u8], wanted: bool| {
                if wanted { zstd::encode_all(data, 1) } else { Ok(data.to_vec()) }
            };
            let data = packed(&[7; 90], mode == "MESSAGE")?;
            let bytes = if storage == "mcap" { mcap_of(&data)? } else { database(&data)? };
            let bytes = packed(&bytes, mode == "FILE")?;
            let about = about(version, storage, mode);
            let length = (about.len() as u16).to_le_bytes();
            let input = [&length[..], about.as_bytes(), &bytes].concat();
            folder.add(&format!("{storage}-{version}-{mode}"), &input)?;
        }
    }
    Ok(())
}

fn mcap_of(data: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    let mut writer = bagpipe_mcap::McapWriter::new(bagpipe_mcap::WriterOptions::default());
    let id = writer.add_connection(&Connection { topic: "/a".to_owned(), ..Connection::default() });
    for number in 0..8 {
        writer.write(id, number * 5_000_000, data)?;
    }
    Ok(writer.finish()?)
}

fn database(data: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    let file = rusqlite::Connection::open_in_memory()?;
    // The smallest pages, so that damage finds what is in them.
    file.execute_batch("PRAGMA page_size = 512;")?;
    file.execute_batch(TABLES)?;
    let topic = "INSERT INTO topics VALUES (?1, ?2, 'std_msgs/msg/String', 'cdr', ?3)";
    file.execute(topic, (7, "/a", QOS))?;
    file.execute(topic, (8, "/b", ""))?;
    for number in 0..8i64 {
        let message = "INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)";
        file.execute(message, (7 + number % 2, number * 5_000_000, data))?;
    }
    Ok(file.serialize("main")?.to_vec())
}

fn about(version: u64, storage: &str, mode: &str) -> String {
    let format = if mode.is_empty() { "" } else { "zstd" };
    let qos = match version {
        9 => format!("\n          {}", QOS.replace('\n', "\n          ")),
        _ => format!("{QOS:?}"),
    };
    format!(
        "rosbag2_bagfile_information:\n  version: {version}\n  storage_identifier: {storage}\n  \
         message_count: 8\n  topics_with_message_count:\n    - topic_metadata:\n        name: /a\n\
         \x20       type: std_msgs/msg/String\n        serialization_format: cdr\n        \
         offered_qos_profiles: {qos}\n      message_count: 8\n  compression_format: \"{format}\"\n\
         \x20 compression_mode: \"{mode}\"\n  relative_file_paths:\n    - a.{storage}\n"
    )
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend_from_slice(&((name.len() + 1 + value.len()) as u32).to_le_bytes());
        header.extend_from_slice(&[name.as_bytes(), b"=", value].concat());
    }
    let length = (header.len() as u32).to_le_bytes();
    [&length[..], &header, &(data.len() as u32).to_le_bytes(), data].concat()
}

/// A bag of format 1.2 behind its first line; its header is not padded, so that damage finds
/// the rest.
fn old_bag(messages: u32) -> Vec<u8> {
    let head = |index: u64| {
        let index = index.to_le_bytes();
        record(&[("op", &[3]), ("index_pos", &index)], b"    ")
    };
    let kind: [(&str, &[u8]); 2] =
        [("type", b"std_msgs/String"), ("md5", b"992ce8a1687cec8c8bd883ec73ca41d1")];
    let (mut records, mut index) = (Vec::new(), Vec::new());
    for (topic, latching) in [("/a", "0"), ("/map", "1")] {
        let topic: (&str, &[u8]) = ("topic", topic.as_bytes());
        let [datatype, md5] = kind;
        let fields = [("op", &[1][..]), topic, md5, datatype, ("def", b"string data\n")];
        records.extend(record(&fields, &[]));
        for number in 0..messages {
            let (sec, nsec) = (number.to_le_bytes(), 500u32.to_le_bytes());
            index.extend([&sec[..], &nsec, &(records.len() as u64).to_le_bytes()].concat());
            let (sec, nsec) = (("sec", &sec[..]), ("nsec", &nsec[..]));
            let caller: (&str, &[u8]) = ("callerid", b"/talker");
            let latching = ("latching", latching.as_bytes());
            let fields = [("op", &[2][..]), topic, md5, datatype, sec, nsec, caller, latching];
            records.extend(record(&fields, &[number as u8; 40]));
        }
    }
    let position = (b"#ROSBAG V1.2\n".len() + head(0).len() + records.len()) as u64;
    let count = (2 * messages).to_le_bytes();
    let fields = [("op", &[4][..]), ("ver", &[0; 4]), ("topic", b"/a"), ("count", &count)];
    [head(position), records, record(&fields, &index)].concat()
}

fn chunks(folder: &Folder) -> Outcome {
    let noise = (0..3000u32).map(|at| (at.wrapping_mul(2_654_435_761) >> 24) as u8);
    let texts = [Vec::new(), vec![7; 5000], noise.collect(), b"number 1 number 2".repeat(9)];
    for (kind, compression) in [(0, Compression::Lz4), (1, Compression::Bz2)] {
        for (number, text) in texts.iter().enumerate() {
            let [low, high] = (text.len() as u16).to_le_bytes();
            let input = [&[kind, low, high][..], &pack(compression, text)?].concat();
            folder.add(&format!("{}-{number}", compression.name()), &input)?;
        }
    }
    Ok(())
}

/// The frames of docs/reference/binpipe-vectors.json: every run of hexadecimal digits in it.
fn frames(folder: &Folder) -> Outcome {
    let vectors =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/reference/binpipe-vectors.json");
    let text = fs::read_to_string(vectors)?;
    let words = text.split('"').filter(|word| word.len() >= 16 && word.len() % 2 == 0);
    for (number, word) in
        words.filter(|word| word.bytes().all(|b| b.is_ascii_hexdigit())).enumerate()
    {
        let digits = (0..word.len()).step_by(2).map(|at| u8::from_str_radix(&word[at..at + 2], 16));
        let bytes: Vec<u8> = std::iter::once(Ok(7)).chain(digits).collect::<Result<_, _>>()?;
        folder.add(&format!("vector-{number}"), &bytes)?;
    }
    Ok(())
}

fn map(entries: &[(&str, rmpv::Value)]) -> rmpv::Value {
    rmpv::Value::Map(entries.iter().map(|(key, value)| ((*key).into(), value.clone())).collect())
}

/// A case with everything that a worker may say.
fn case() -> rmpv::Value {
    let list =
        |words: &[&str]| rmpv::Value::Array(words.iter().map(|word| (*word).into()).collect());
    let window = map(&[("lead_in_start", 1.into()), ("start", 2.into()), ("end", u64::MAX.into())]);
    let stack = map(&[
        ("command", list(&["roslaunch", "lane", "lane.launch"])),
        ("environment", map(&[("A", "b".into())])),
        ("parameters", map(&[("/gain", 0.5.into()), ("/names", list(&["a", "b"]))])),
        ("remap", map(&[("/image", "/camera/image".into())])),
    ]);
    let step = map(&[
        ("trigger", "/image".into()),
        ("answer", "/lane".into()),
        ("deadline", 2.0.into()),
        ("by", "stamp".into()),
        ("optional", true.into()),
    ]);
    let steps = rmpv::Value::Array(vec![step]);
    map(&[
        ("id", "pr2-0003".into()),
        ("window", window),
        ("topics", list(&["/image"])),
        ("stack", stack),
        ("playback", map(&[("mode", "lockstep".into()), ("rate", 1.0.into()), ("steps", steps)])),
        ("record", map(&[("topics", list(&["/lane/.*"])), ("byte_budget", 1000.into())])),
        ("deadlines", map(&[("start", 30.0.into()), ("case", 600.0.into())])),
    ])
}

fn greetings(folder: &Folder) -> Outcome {
    let session = "0123456789abcdef0123456789abcdef".to_owned();
    let software = "bagpipe 0.1.0".to_owned();
    let hello = WorkerHello {
        session: session.clone(),
        protocol: 1,
        software: software.clone(),
        case: case(),
    };
    let answer = AgentHello { session: session.clone(), protocol: 1, software, pipe_bytes: 65536 };
    let ranges = vec![(0, 100, 4096), (4096, 9000, 10)];
    let file = FileHeader { name: "case.bag".to_owned(), size: 4106, ranges };
    let metric = Metric { stage: "play".to_owned(), sent: 10, recorded: 3, bag_seconds: 1.5 };
    let abort = Abort {
        reason: "StackExited".to_owned(),
        message: "the stack ended".to_owned(),
        exit_status: Some(1),
        stderr: vec!["no".to_owned()],
        session,
        ..Abort::default()
    };
    let maps = [
        to_map(&hello)?,
        to_map(&answer)?,
        to_map(&file)?,
        to_map(&metric)?,
        to_map(&End { files: 1, bytes: 4106, digest: 0xdead_beef })?,
        to_map(&abort)?,
    ];
    for (kind, payload) in maps.iter().enumerate() {
        folder.add(&format!("map-{kind}"), &[&[kind as u8][..], payload].concat())?;
    }
    // Lists in lists, each of which claims to be as long as the format can say.
    let mut deep = maps[0][..maps[0].len() / 2].to_vec();
    for _ in 0..200 {
        deep.extend_from_slice(&[0xdd, 0xff, 0xff, 0xff, 0xff]);
    }
    folder.add("deep", &[&[0], &deep[..]].concat())?;
    Ok(())
}

fn headers(folder: &Folder) -> Outcome {
    let subscriber = [
        ("callerid", "/listener"),
        ("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1"),
        ("message_definition", "int8 A=1\nstring data\n"),
        ("tcp_nodelay", "1"),
        ("topic", "/chatter"),
        ("type", "std_msgs/String"),
    ];
    folder.add("subscriber", &write_header(&subscriber))?;
    folder.add("latching", &write_header(&[("latching", "1"), ("md5sum", "*")]))?;
    folder.add("empty", &write_header(&[]))?;
    folder.add("error", &write_header(&[("error", "topic is not published here")]))?;
    Ok(())
}

fn messages(folder: &Folder) -> Outcome {
    for size in [1u8, 7, 255] {
        let mut bytes = vec![size];
        for length in [0usize, 1, 12, 300] {
            bytes.extend_from_slice(&(length as u32).to_le_bytes());
            bytes.extend(std::iter::repeat_n(length as u8, length));
        }
        folder.add(&format!("pieces-{size}"), &bytes)?;
        bytes.extend_from_slice(&u32::MAX.to_le_bytes());
        folder.add(&format!("too-large-{size}"), &bytes)?;
    }
    Ok(())
}

fn http(folder: &Folder) -> Outcome {
    let post = |version: &str, more: &str, body: &str| {
        let length = body.len();
        format!("POST /RPC2 HTTP/{version}\r\nContent-Length: {length}\r\n{more}\r\n{body}")
    };
    let call = write_call("getPid", &["/me".into()])?;
    let one = post("1.1", "Host: robot:1234\r\nUser-Agent: x\r\n", &call);
    let two =
        post("1.0", "Connection: keep-alive\r\n", "x") + &post("1.1", "Connection: close\r\n", "");
    for (name, text) in [("one", &one), ("two", &two), ("both", &(one.clone() + &two))] {
        folder.add(name, &[&[3], text.as_bytes()].concat())?;
    }
    folder.add("get", b"\x05GET / HTTP/1.1\r\n\r\n")?;
    Ok(())
}

fn xmlrpc(folder: &Folder) -> Outcome {
    let uris: Value = vec!["http://a:1/".into(), "http://b:2/".into()].into();
    let parameters = Value::Map(
        [
            ("gain".to_owned(), 0.5.into()),
            ("on".to_owned(), true.into()),
            ("names".to_owned(), vec!["a <b> & \"c\"".into(), Value::Int(-3)].into()),
        ]
        .into(),
    );
    let calls = [
        ("publisherUpdate", vec!["/master".into(), "/chatter".into(), uris.clone()]),
        (
            "requestTopic",
            vec!["/me".into(), "/a".into(), vec![vec!["TCPROS".into()].into()].into()],
        ),
        ("setParam", vec!["/me".into(), "/gains".into(), parameters.clone()]),
        ("getPid", Vec::new()),
    ];
    for (method, params) in calls {
        let xml = write_call(method, &params)?;
        folder.add(method, &[&[0], xml.as_bytes()].concat())?;
    }
    for (number, value) in [uris, parameters, Value::Int(7)].into_iter().enumerate() {
        let triple = vec![Value::Int(1), "fine".into(), value].into();
        let xml = write_answer(&triple)?;
        folder.add(&format!("answer-{number}"), &[&[1], xml.as_bytes()].concat())?;
    }
    let fault = "<?xml version=\"1.0\"?><methodResponse><fault><value><struct><member>\
        <name>faultCode</name><value><int>4</int></value></member><member>\
        <name>faultString</name><value><string>no</string></value></member></struct></value>\
        </fault></methodResponse>";
    folder.add("fault", &[&[1], fault.as_bytes()].concat())?;
    let bare =
        "<methodResponse><params><param><value>bare</value></param></params></methodResponse>";
    folder.add("bare", &[&[1], bare.as_bytes()].concat())?;
    Ok(())
}
