//! As docs/examples/binpipe/repeat.py: as many copies of each record as its field `copies` says.

use bagpipe_binpipe::{Error, Field, Pipe};

fn main() -> Result<(), Error> {
    let mut pipe = Pipe::standard()?;
    while let Some(record) = pipe.next_record()? {
        // It reaches stderr: the Pipe keeps stdout for the frames.
        println!("got {}", record.name);
        let number = |key| match record.fields.get(key) {
            Some(Field::Integer(number)) => Some(*number as i32),
            _ => None,
        };
        if let Some(status) = number("exit") {
            eprintln!("leaving early");
            std::process::exit(status);
        }
        if let Some(signal) = number("signal").and_then(rustix::process::Signal::from_named_raw) {
            let _ = rustix::process::kill_process(rustix::process::getpid(), signal);
        }
        let data = pipe.read()?;
        let mut fields = record.fields.clone();
        fields.remove("copies");
        fields.insert("bytes_in".to_owned(), Field::Integer(data.len() as i64));
        for copy in 0..number("copies").unwrap_or(1) {
            let name = format!("{}#{copy}", record.name);
            if fields.contains_key("stream") {
                pipe.begin(&name, None, &fields)?;
                pipe.append(&data)?;
            } else {
                pipe.write(&name, &data, &fields)?;
            }
        }
    }
    pipe.finish()
}
