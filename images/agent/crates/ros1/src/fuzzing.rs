//! The parsers of what other nodes send, for the fuzz targets and their corpora only (feature
//! `fuzzing`): bytes in, what was understood out.

use std::io::Read;

use dxr::{MethodCall, MethodResponse};

use crate::frames::{Frame, Frames};
use crate::header::ConnectionHeader;
use crate::{RosError, Value, calls, http, pages, xmlrpc};

/// A whole connection header, its length before it.
///
/// # Errors
/// The sentence of what is wrong.
pub fn read_header(mut bytes: &[u8]) -> Result<ConnectionHeader, String> {
    ConnectionHeader::read(&mut bytes)
}

/// A header as it is sent.
pub fn write_header(fields: &[(&str, &str)]) -> Vec<u8> {
    let header = ConnectionHeader::new();
    fields.iter().fold(header, |header, (name, value)| header.with(name, value)).encode()
}

/// The same header as it is sent.
pub fn write_same_header(header: &ConnectionHeader) -> Vec<u8> {
    header.encode()
}

/// The bodies of the requests in a stream, and whether it ended without an error.
pub fn read_requests(stream: &mut impl Read) -> (Vec<String>, bool) {
    let (mut buffer, mut bodies, room) = (Vec::new(), Vec::new(), http::Room::default());
    loop {
        match http::read_request(stream, &mut buffer, &room) {
            Ok(Some(request)) => bodies.push(request.body),
            Ok(None) => return (bodies, true),
            Err(_) => return (bodies, false),
        }
    }
}

/// The method and the path of the first request that [`crate::Pages`] reads in a stream.
pub fn read_page_request(stream: &mut impl Read) -> Option<(String, String)> {
    pages::read(stream).ok().flatten().map(|head| (head.method, head.path))
}

/// A call's method and parameters.
///
/// # Errors
/// The sentence of what is wrong.
pub fn read_call(xml: &str) -> Result<(String, Vec<Value>), String> {
    calls::parse(xml)
}

/// The XML of a call.
///
/// # Errors
/// An integer beyond 32 bits.
pub fn write_call(method: &str, params: &[Value]) -> Result<String, RosError> {
    let params = params.iter().map(Value::to_wire).collect::<Result<_, _>>()?;
    Ok(MethodCall { name: method.to_owned().into(), params }.to_xml().unwrap_or_default())
}

/// The value of an answer.
///
/// # Errors
/// A fault, or the sentence of what is wrong.
pub fn read_answer(xml: &str) -> Result<Value, RosError> {
    xmlrpc::parse("fuzzing", "http://127.0.0.1:1/", xml)
}

/// The XML of an answer.
///
/// # Errors
/// An integer beyond 32 bits.
pub fn write_answer(value: &Value) -> Result<String, RosError> {
    Ok(MethodResponse { value: value.to_wire()? }.to_xml().unwrap_or_default())
}

/// Gives `each` the messages of a connection; at the end whether
/// none was longer than `max_message`.
pub fn read_messages(
    stream: &mut impl Read,
    max_message: usize,
    mut each: impl FnMut(&[u8]),
) -> bool {
    let mut frames = Frames::new();
    while frames.fill(stream).is_ok_and(|read| read > 0) {
        loop {
            match frames.next(max_message) {
                Frame::Whole(data) => each(data),
                Frame::Unfinished | Frame::Part => break,
                Frame::TooLarge(_) => return false,
            }
        }
    }
    true
}
