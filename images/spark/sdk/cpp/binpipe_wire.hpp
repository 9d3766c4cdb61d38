// What binpipe.hpp needs of the wire: CRC-32C and the MessagePack of records' fields.
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <variant>

#if defined(__x86_64__)
#include <nmmintrin.h>
#endif

namespace binpipe {

class Error : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

// Bytes in a record's fields, as opposed to text.
struct Bytes {
  std::string data;
  bool operator==(const Bytes& other) const { return data == other.data; }
};

struct Field : std::variant<std::string, std::int64_t, Bytes> {
  using variant::variant;
  Field(const char* text) : variant(std::string(text)) {}
  Field(int number) : variant(std::int64_t{number}) {}
};
using Fields = std::map<std::string, Field>;

namespace detail {

inline const std::array<std::uint32_t, 256>& crc_table() {
  static const auto table = [] {
    std::array<std::uint32_t, 256> made{};
    for (std::uint32_t n = 0; n < 256; ++n) {
      std::uint32_t value = n;
      for (int bit = 0; bit < 8; ++bit) value = value >> 1 ^ (value & 1 ? 0x82F63B78u : 0);
      made[n] = value;
    }
    return made;
  }();
  return table;
}

inline std::uint32_t crc_slow(std::uint32_t value, const char* data, std::size_t size) {
  for (std::size_t n = 0; n < size; ++n)
    value = value >> 8 ^ crc_table()[(value ^ static_cast<std::uint8_t>(data[n])) & 0xFF];
  return value;
}

#if defined(__x86_64__)
// The product of two polynomials modulo CRC-32C's, bits reflected as the checksum has them.
inline std::uint32_t times(std::uint32_t one, std::uint32_t other) {
  std::uint32_t product = 0;
  for (std::uint32_t bit = 1u << 31; bit; bit >>= 1) {
    if (one & bit) product ^= other;
    other = other >> 1 ^ (other & 1 ? 0x82F63B78u : 0);
  }
  return product;
}

// What a checksum is multiplied with to stand `bytes` further ahead.
inline std::uint32_t ahead(std::uint64_t bytes) {
  std::uint32_t power = 1u << 31, square = 1u << 30;
  for (std::uint64_t bits = 8 * bytes; bits; bits >>= 1, square = times(square, square))
    if (bits & 1) power = times(square, power);
  return power;
}

constexpr std::size_t kLane = 8192;

__attribute__((target("sse4.2"))) inline std::uint32_t crc_fast(std::uint32_t value,
                                                               const char* data, std::size_t size) {
  // The instruction's answer takes three cycles, and one can begin in each: three lanes.
  static const std::uint32_t lane = ahead(kLane);
  for (; size >= 3 * kLane; size -= 3 * kLane, data += 3 * kLane) {
    std::uint64_t first = value, second = 0, third = 0;
    for (std::size_t at = 0; at < kLane; at += 8) {
      std::uint64_t words[3];
      for (int n = 0; n < 3; ++n) std::memcpy(&words[n], data + n * kLane + at, 8);
      first = _mm_crc32_u64(first, words[0]);
      second = _mm_crc32_u64(second, words[1]);
      third = _mm_crc32_u64(third, words[2]);
    }
    const auto two = times(lane, static_cast<std::uint32_t>(first)) ^ second;
    value = times(lane, static_cast<std::uint32_t>(two)) ^ static_cast<std::uint32_t>(third);
  }
  std::uint64_t wide = value;
  for (; size >= 8; size -= 8, data += 8) {
    std::uint64_t word;
    std::memcpy(&word, data, 8);
    wide = _mm_crc32_u64(wide, word);
  }
  value = static_cast<std::uint32_t>(wide);
  for (; size; --size, ++data) value = _mm_crc32_u8(value, static_cast<unsigned char>(*data));
  return value;
}
#endif

// CRC-32C (Castagnoli), continued from `checksum`.
inline std::uint32_t crc(std::uint32_t checksum, const char* data, std::size_t size) {
#if defined(__x86_64__)
  static const bool fast = __builtin_cpu_supports("sse4.2");
  if (fast) return ~crc_fast(~checksum, data, size);
#endif
  return ~crc_slow(~checksum, data, size);
}

inline void put_little(char* at, std::uint32_t value) {
  for (int n = 0; n < 4; ++n) at[n] = static_cast<char>(value >> 8 * n);
}

inline std::uint32_t get_little(const char* at) {
  std::uint32_t value = 0;
  for (int n = 0; n < 4; ++n) value |= std::uint32_t{static_cast<std::uint8_t>(at[n])} << 8 * n;
  return value;
}

// --- MessagePack: maps of strings, integers, bytes and nil ---

inline void put_big(std::string& out, std::uint64_t value, int bytes) {
  for (int n = bytes - 1; n >= 0; --n) out += static_cast<char>(value >> 8 * n);
}

inline void pack_int(std::string& out, std::int64_t value) {
  const auto bits = static_cast<std::uint64_t>(value);
  if (value >= -32 && value <= 127) return put_big(out, bits, 1);
  int exponent = 0;
  if (value >= 0) {
    while (exponent < 3 && bits >> (8 << exponent)) ++exponent;
  } else {
    while (exponent < 3 && value < -(std::int64_t{1} << ((8 << exponent) - 1))) ++exponent;
  }
  out += static_cast<char>((value >= 0 ? 0xCC : 0xD0) + exponent);
  put_big(out, bits, 1 << exponent);
}

inline void pack_sized(std::string& out, std::size_t size, int fixed, std::size_t most, int first) {
  if (size <= most && fixed) return put_big(out, fixed | size, 1);
  const int exponent = size < 256 ? 0 : size < 65536 ? 1 : 2;
  out += static_cast<char>(first + exponent);
  put_big(out, size, 1 << exponent);
}

inline void pack_string(std::string& out, std::string_view text) {
  pack_sized(out, text.size(), 0xA0, 31, 0xD9);
  out += text;
}

inline void pack_map(std::string& out, std::size_t size) {
  if (size <= 15) return put_big(out, 0x80 | size, 1);
  out += static_cast<char>(size < 65536 ? 0xDE : 0xDF);
  put_big(out, size, size < 65536 ? 2 : 4);
}

inline void pack_fields(std::string& out, const Fields& fields) {
  pack_map(out, fields.size());
  for (const auto& [key, value] : fields) {
    pack_string(out, key);
    if (const auto* text = std::get_if<std::string>(&value)) {
      pack_string(out, *text);
    } else if (const auto* number = std::get_if<std::int64_t>(&value)) {
      pack_int(out, *number);
    } else {
      const auto& data = std::get<Bytes>(value).data;
      pack_sized(out, data.size(), 0, 0, 0xC4);
      out += data;
    }
  }
}

class Reader {
 public:
  explicit Reader(std::string_view data) : data_(data) {}

  std::size_t map_size() {
    const int code = byte();
    if ((code & 0xF0) == 0x80) return code & 0x0F;
    if (code == 0xDE || code == 0xDF) return number(code == 0xDE ? 2 : 4);
    throw Error("a frame that should hold a map holds something else");
  }

  std::string text() {
    auto value = field();
    if (!value || !std::holds_alternative<std::string>(*value)) throw Error("a name is no string");
    return std::get<std::string>(std::move(*value));
  }

  // A string, integer or bytes; nothing for nil, booleans, floats, and maps and lists of them.
  std::optional<Field> field() {
    const int code = byte();
    if (code < 0x80) return Field(std::int64_t{code});
    if (code >= 0xE0) return Field(std::int64_t{code} - 256);
    if (code < 0xA0) return skip((code & 0x0F) * (code < 0x90 ? 2 : 1));
    if (code < 0xC0) return Field(std::string(take(code & 0x1F)));
    if (code == 0xC0 || code == 0xC2 || code == 0xC3) return std::nullopt;
    if (code >= 0xC4 && code <= 0xC6)
      return Field(Bytes{std::string(take(number(1 << (code - 0xC4))))});
    if (code == 0xCA || code == 0xCB) return take(code == 0xCA ? 4 : 8), std::nullopt;
    if (code >= 0xCC && code <= 0xCF)
      return Field(static_cast<std::int64_t>(number(1 << (code - 0xCC))));
    if (code >= 0xD0 && code <= 0xD3) {
      const int bits = 8 << (code - 0xD0);
      const std::uint64_t raw = number(bits / 8) << (64 - bits);
      return Field(static_cast<std::int64_t>(raw) >> (64 - bits));
    }
    if (code >= 0xD9 && code <= 0xDB) return Field(std::string(take(number(1 << (code - 0xD9)))));
    if (code == 0xDC || code == 0xDD) return skip(number(code == 0xDC ? 2 : 4));
    if (code == 0xDE || code == 0xDF) return skip(2 * number(code == 0xDE ? 2 : 4));
    throw Error("a frame's map holds a type that has no place there");
  }

 private:
  int byte() { return static_cast<std::uint8_t>(take(1)[0]); }

  std::uint64_t number(int bytes) {
    std::uint64_t value = 0;
    for (char each : take(bytes)) value = value << 8 | static_cast<std::uint8_t>(each);
    return value;
  }

  std::string_view take(std::size_t size) {
    if (size > data_.size() - at_) throw Error("a frame's map is cut");
    at_ += size;
    return data_.substr(at_ - size, size);
  }

  std::optional<Field> skip(std::uint64_t items) {
    if (++depth_ > 32) throw Error("a frame's map is nested too deep");
    for (std::uint64_t n = 0; n < items; ++n) field();
    --depth_;
    return std::nullopt;
  }

  std::string_view data_;
  std::size_t at_ = 0;
  int depth_ = 0;
};

}  // namespace detail

}  // namespace binpipe
