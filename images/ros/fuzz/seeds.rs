//! Writes the seed corpus: small bags of each compression, whole, cut and reindexed, and the
//! pipe's test vectors. `cargo run --bin seeds -- corpus`.

use std::error::Error;
use std::fs;
use std::path::Path;

use bagpipe_bag::{BagWriter, Compression, Connection, WriterOptions};

fn main() -> Result<(), Box<dyn Error>> {
    let root = std::env::args().nth(1).unwrap_or_else(|| "corpus".to_owned());
    let root = Path::new(&root);
    for target in ["open", "scan", "parts"] {
        fs::create_dir_all(root.join(target))?;
        for compression in [Compression::None, Compression::Lz4, Compression::Bz2] {
            for messages in [0, 1, 8] {
                let bag = bag(compression, messages)?;
                let name = format!("{}-{messages}", compression.name());
                fs::write(root.join(target).join(format!("{name}-cut")), &bag[..bag.len() / 2])?;
                fs::write(root.join(target).join(name), bag)?;
            }
        }
    }
    frames(&root.join("frames"))
}

fn bag(compression: Compression, messages: u64) -> Result<Vec<u8>, Box<dyn Error>> {
    let options = WriterOptions { compression, chunk_threshold: 300, byte_budget: None };
    let mut writer = BagWriter::new(options);
    for (topic, latching) in [("/a", false), ("/map", true)] {
        writer.add_connection(&Connection {
            topic: topic.to_owned(),
            datatype: "std_msgs/String".to_owned(),
            md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".to_owned(),
            latching,
            ..Connection::default()
        });
    }
    for number in 0..messages {
        writer.write((number % 2) as u32, number * 5_000_000, &[number as u8; 90])?;
    }
    Ok(writer.finish()?)
}

/// The frames of docs/reference/binpipe-vectors.json: every run of hexadecimal digits in it.
fn frames(folder: &Path) -> Result<(), Box<dyn Error>> {
    fs::create_dir_all(folder)?;
    let vectors =
        concat!(env!("CARGO_MANIFEST_DIR"), "/../../../docs/reference/binpipe-vectors.json");
    let text = fs::read_to_string(vectors)?;
    let words = text.split('"').filter(|word| word.len() >= 16 && word.len() % 2 == 0);
    for (number, word) in
        words.filter(|word| word.bytes().all(|b| b.is_ascii_hexdigit())).enumerate()
    {
        let digits = (0..word.len()).step_by(2).map(|at| u8::from_str_radix(&word[at..at + 2], 16));
        let bytes: Vec<u8> = std::iter::once(Ok(7)).chain(digits).collect::<Result<_, _>>()?;
        fs::write(folder.join(format!("vector-{number}")), bytes)?;
    }
    Ok(())
}
