//! Addresses of the graph: splitting URIs and resolving host names.
//!
//! The agent is a static binary that runs inside images it has never seen. A static
//! glibc loads the image's own name-service plugins, which may not fit, so the names that
//! occur in a pod (literals, localhost, /etc/hosts) are resolved here and only the rest
//! goes to the C library.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpStream, ToSocketAddrs, UdpSocket};
use std::time::Duration;

use crate::RosError;

/// The host and the port of `http://host:port/` or `rosrpc://host:port`.
pub(crate) fn split_uri(uri: &str) -> Result<(&str, u16), RosError> {
    let bad = |why: &str| RosError::BadUri { uri: uri.to_owned(), why: why.to_owned() };
    let (_, rest) = uri.split_once("://").ok_or_else(|| bad("it has no scheme"))?;
    let authority = rest.split(['/', '?']).next().unwrap_or(rest);
    let (host, port) = authority.rsplit_once(':').ok_or_else(|| bad("it has no port"))?;
    let port = port.parse().map_err(|_| bad("its port is not a number up to 65535"))?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    if host.is_empty() {
        return Err(bad("it has no host"));
    }
    Ok((host, port))
}

/// The address of a host name and a port.
pub(crate) fn resolve(host: &str, port: u16) -> Result<SocketAddr, RosError> {
    if let Ok(ip) = host.parse::<IpAddr>() {
        return Ok(SocketAddr::new(ip, port));
    }
    if host.eq_ignore_ascii_case("localhost") {
        return Ok(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port));
    }
    if let Some(ip) = std::fs::read_to_string("/etc/hosts").ok().and_then(|t| in_hosts(&t, host)) {
        return Ok(SocketAddr::new(ip, port));
    }
    if rustix::system::uname().nodename().to_bytes() == host.as_bytes() {
        return Ok(SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), port));
    }
    let mut found = (host, port)
        .to_socket_addrs()
        .map_err(RosError::io(format!("the host name \"{host}\" could not be resolved")))?;
    found.next().ok_or_else(|| RosError::BadUri {
        uri: format!("{host}:{port}"),
        why: "the host name has no address".to_owned(),
    })
}

/// The address of a name in the text of a hosts file; IPv4 before IPv6, because roscpp
/// and rospy listen on IPv4 by default.
fn in_hosts(text: &str, host: &str) -> Option<IpAddr> {
    let addresses = text.lines().filter_map(|line| {
        let mut words = line.split('#').next()?.split_whitespace();
        let ip: IpAddr = words.next()?.parse().ok()?;
        words.any(|word| word.eq_ignore_ascii_case(host)).then_some(ip)
    });
    let mut sixth = None;
    for ip in addresses {
        if ip.is_ipv4() {
            return Some(ip);
        }
        sixth.get_or_insert(ip);
    }
    sixth
}

/// Connects to a host with a deadline.
pub(crate) fn connect(host: &str, port: u16, deadline: Duration) -> Result<TcpStream, RosError> {
    let address = resolve(host, port)?;
    TcpStream::connect_timeout(&address, deadline)
        .map_err(RosError::io(format!("no connection to {host}:{port}")))
}

/// Whether nobody listens at a node's address any more, by the kernel's word: one that can't be resolved, or has no
/// room for more connections within the deadline, may still be there.
pub fn is_closed(uri: &str, deadline: Duration) -> bool {
    let address = split_uri(uri).and_then(|(host, port)| resolve(host, port));
    let connected = address.map(|address| TcpStream::connect_timeout(&address, deadline));
    matches!(connected, Ok(Err(error)) if error.kind() == ErrorKind::ConnectionRefused)
}

/// The address of this machine as the given host sees it: what we listen on and
/// advertise. The kernel's route decides; no packet is sent.
pub(crate) fn local_address_towards(host: &str, port: u16) -> Result<IpAddr, RosError> {
    let target = resolve(host, port)?;
    let any: SocketAddr = match target {
        SocketAddr::V4(_) => SocketAddr::new(IpAddr::V4(Ipv4Addr::UNSPECIFIED), 0),
        SocketAddr::V6(_) => SocketAddr::new(IpAddr::V6(std::net::Ipv6Addr::UNSPECIFIED), 0),
    };
    let failed = || format!("no route to {host}:{port}");
    let socket = UdpSocket::bind(any).map_err(RosError::io(failed()))?;
    socket.connect(target).map_err(RosError::io(failed()))?;
    Ok(socket.local_addr().map_err(RosError::io(failed()))?.ip())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uris_of_masters_and_nodes_are_split() {
        assert_eq!(split_uri("http://pod-7:11311/").unwrap(), ("pod-7", 11311));
        assert_eq!(split_uri("http://[::1]:80").unwrap(), ("::1", 80));
        for bad in ["11311", "http://pod-7/", "http://pod-7:70000/", "http://:1/"] {
            assert!(split_uri(bad).unwrap_err().to_string().contains(bad), "{bad}");
        }
    }

    #[test]
    fn the_hosts_file_is_read_with_comments_aliases_and_ipv4_first() {
        let text = "# pods\n::1 robot\n10.1.2.3\trobot.local robot # here\n";
        assert_eq!(in_hosts(text, "ROBOT"), Some("10.1.2.3".parse().unwrap()));
        assert_eq!(in_hosts(text, "here"), None);
    }

    #[test]
    fn the_way_to_loopback_is_loopback() {
        let ip = local_address_towards("localhost", 11311).unwrap();
        assert_eq!(ip, IpAddr::V4(Ipv4Addr::LOCALHOST));
    }

    #[test]
    fn an_address_is_closed_once_nobody_listens_there() {
        let listener = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let uris = [
            format!("http://localhost:{port}/RPC2"),
            format!("http://127.0.0.1:{port}/"),
            format!("rosrpc://localhost:{port}"),
        ];
        let closed = || uris.each_ref().map(|uri| is_closed(uri, Duration::from_secs(5)));
        assert_eq!(closed(), [false; 3]);
        drop(listener);
        assert_eq!(closed(), [true; 3]);
        assert!(!is_closed("nowhere", Duration::from_secs(5)));
    }
}
