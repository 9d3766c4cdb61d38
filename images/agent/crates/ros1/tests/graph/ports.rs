//! Ports of loopback for servers of tests, of which no two processes take the same.

use std::net::{Ipv4Addr, TcpStream};
use std::ops::Range;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::{Mutex, PoisonError};

/// Below those that connections take by themselves: one of these could be taken before its server
/// listens, or while that is restarted. Those of the tests in Python follow.
const PORTS: Range<u16> = 12_000..20_000;

/// The names of all ports that this process took, which it keeps to its end.
static HELD: Mutex<Vec<UnixDatagram>> = Mutex::new(Vec::new());

/// The first of `count` ports in a row on which nothing listens, and that no other call of this or
/// another process gets.
pub fn free_ports(count: u16) -> u16 {
    let mut held = HELD.lock().unwrap_or_else(PoisonError::into_inner);
    // From another place in each process, so that few find what another has.
    let places = PORTS.end - PORTS.start - count;
    let begin = (std::process::id().wrapping_mul(97) % u32::from(places)) as u16;
    for place in (0..places).map(|n| PORTS.start + (begin + n) % places) {
        let names: Vec<UnixDatagram> = (place..place + count).map_while(hold).collect();
        if names.len() == usize::from(count) && (place..place + count).all(is_free) {
            held.extend(names);
            return place;
        }
    }
    panic!("no {count} ports of loopback in a row are left for a test");
}

/// The port's name, unless somebody has it.
fn hold(port: u16) -> Option<UnixDatagram> {
    let name = SocketAddr::from_abstract_name(format!("bagpipe-test-port-{port}")).unwrap();
    UnixDatagram::bind_addr(&name).ok()
}

/// Whether nothing listens. A listener of our own would be inherited by whatever process another
/// thread starts at this moment, and the port be taken until that executes its program.
fn is_free(port: u16) -> bool {
    TcpStream::connect((Ipv4Addr::LOCALHOST, port)).is_err()
}
