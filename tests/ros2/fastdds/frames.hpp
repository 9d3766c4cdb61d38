// What goes over standard input and output: a kind (a letter), a length (u32), and so many bytes.
#pragma once
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <mutex>
#include <vector>

inline bool read_whole(void* into, size_t length) {
  for (auto* at = static_cast<uint8_t*>(into); length > 0;) {
    ssize_t some = read(STDIN_FILENO, at, length);
    if (some <= 0) return false;
    at += some;
    length -= static_cast<size_t>(some);
  }
  return true;
}

// Whoever reads it is gone: so is this program.
inline void write_whole(const void* from, size_t length) {
  for (auto* at = static_cast<const uint8_t*>(from); length > 0;) {
    ssize_t some = write(STDOUT_FILENO, at, length);
    if (some <= 0) _exit(1);
    at += some;
    length -= static_cast<size_t>(some);
  }
}

inline void send_frame(char kind, const void* bytes, uint32_t length) {
  static std::mutex one_at_a_time;
  std::lock_guard<std::mutex> lock(one_at_a_time);
  write_whole(&kind, 1);
  write_whole(&length, sizeof length);
  write_whole(bytes, length);
}

inline void send_number(char kind, int32_t number) { send_frame(kind, &number, sizeof number); }

// False at the end of standard input, or where a frame is longer than any test's.
inline bool next_frame(char& kind, std::vector<uint8_t>& bytes) {
  uint32_t length = 0;
  if (!read_whole(&kind, 1) || !read_whole(&length, sizeof length)) return false;
  if (length > 1u << 26) return false;
  bytes.resize(length);
  return read_whole(bytes.data(), length);
}
