// The physical limit: frames of u32 length and body to a socket, in a bare writev loop.
// bare_writev <port> <body bytes> <frames> <frames in a call>
#include <arpa/inet.h>
#include <climits>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <netinet/tcp.h>
#include <string>
#include <sys/socket.h>
#include <sys/uio.h>
#include <unistd.h>
#include <vector>

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  const uint32_t body = strtoul(argv[2], nullptr, 10);
  long left = strtol(argv[3], nullptr, 10);
  const long gather = strtol(argv[4], nullptr, 10);
  // As much memory as a bag has, so that both sides read what no cache holds.
  const size_t frame = body + 4, ring = std::max<size_t>(gather, (256u << 20) / frame);
  std::string memory(ring * frame, 'x');
  for (size_t n = 0; n < ring; ++n) memcpy(&memory[n * frame], &body, 4);
  int fd = socket(AF_INET, SOCK_STREAM, 0), one = 1;
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_port = htons(atoi(argv[1]));
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  if (connect(fd, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) return 1;
  std::vector<iovec> calls(gather);
  for (size_t next = 0; left > 0; left -= gather) {
    const long now = std::min(gather, left);
    size_t total = 0;
    for (long n = 0; n < now; ++n, next = (next + 1) % ring)
      total += (calls[n] = {&memory[next * frame], frame}).iov_len;
    iovec* at = calls.data();
    long count = now;
    while (total > 0) {
      ssize_t sent = writev(fd, at, std::min<long>(count, IOV_MAX));
      if (sent < 0) return 1;
      total -= sent;
      while (count > 0 && static_cast<size_t>(sent) >= at->iov_len) sent -= at->iov_len, ++at, --count;
      if (count > 0) at->iov_base = static_cast<char*>(at->iov_base) + sent, at->iov_len -= sent;
    }
  }
  close(fd);
}
