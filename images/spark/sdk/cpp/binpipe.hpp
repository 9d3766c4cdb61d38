// The C++17 side of user logic: records come in on stdin, records go out on stdout.
//
//     binpipe::Pipe pipe;
//     while (auto record = pipe.next()) {
//       pipe.write(record->name, rotated(record->read()), {{"degrees", 90}});
//     }
//     return pipe.close();
//
// Two headers and nothing else: no library is needed. Construct the Pipe before anything is
// printed: it keeps stdout for frames and lets std::cout and printf write to stderr. What goes
// wrong is a binpipe::Error; one that nobody catches ends the program, and the driver's error
// says so.
// The protocol: docs/reference/binpipe.md, "User logic on stdin and stdout".
#pragma once

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "binpipe_wire.hpp"

namespace binpipe {

namespace detail {

constexpr std::size_t kMaxPayload = 1 << 20, kHeader = 20, kFlush = 256 * 1024;
// From here on a write of its own costs less than a copy.
constexpr std::size_t kDirect = 64 * 1024;
enum Type : std::uint8_t { kHello = 1, kFile = 2, kData = 3, kEnd = 6, kAbort = 7 };

}  // namespace detail

class Pipe;

// One input record. Its bytes are read once, in order, before the next record is asked for.
class Record {
 public:
  std::string name;
  std::optional<std::uint64_t> size;  // empty: known at the end of the record only
  Fields fields;

  // The next piece, at most 1 MiB, valid until the next call; empty at the record's end.
  std::string_view piece();

  // All that is left of the record.
  std::string read() {
    std::string all;
    if (size) all.reserve(*size);
    for (auto part = piece(); !part.empty(); part = piece()) all += part;
    return all;
  }

 private:
  friend class Pipe;
  Pipe* pipe_ = nullptr;
  std::uint64_t taken_ = 0;
  bool ended_ = false;
};

// The session on stdin and stdout.
class Pipe {
 public:
  Pipe() {
    // A child of the program must not keep the frames' descriptors open.
    input_ = ::fcntl(0, F_DUPFD_CLOEXEC, 3);
    output_ = ::fcntl(1, F_DUPFD_CLOEXEC, 3);
    if (input_ < 0 || output_ < 0) throw Error("stdin or stdout is closed");
    const int nothing = ::open("/dev/null", O_RDONLY | O_CLOEXEC);
    ::dup2(nothing, 0);
    ::close(nothing);
    ::dup2(2, 1);
    ::unsetenv("BAGPIPE_BINPIPE");
    buffer_.resize(2 * detail::kMaxPayload);
    if (!next_frame() || kind_ != detail::kHello)
      throw Error("stdin holds no session: such a program is started by bin_piped");
    detail::Reader hello(payload_);
    std::string session;
    for (auto left = hello.map_size(); left; --left) {
      const auto key = hello.text();
      const auto value = hello.field();
      if (key == "session" && value) session = std::get<std::string>(*value);
      if (key == "protocol" && value && std::get<std::int64_t>(*value) != 1)
        throw Error("the worker speaks another protocol");
    }
    std::string answer;
    detail::pack_map(answer, 3);
    put(answer, "session", session);
    put(answer, "protocol", 1);
    put(answer, "software", "bagpipe-binpipe c++ 0.2.0");
    send(detail::kHello, answer);
  }
  Pipe(const Pipe&) = delete;
  Pipe& operator=(const Pipe&) = delete;

  // The next record; what was left of the one before is skipped. Null when there are no more.
  Record* next() {
    if (ended_) return nullptr;
    while (record_ && !record_->ended_) record_->piece();
    need_frame();
    if (kind_ == detail::kEnd) {
      if (number_of("digest") != input_digest_) throw Error("END of the input does not fit");
      ended_ = true;
      return nullptr;
    }
    if (kind_ != detail::kFile) throw Error("a frame that is no FILE stands between two records");
    record_ = std::make_unique<Record>();
    record_->pipe_ = this;
    detail::Reader head(payload_);
    for (auto left = head.map_size(); left; --left) {
      const auto key = head.text();
      if (key == "fields") {
        for (auto fields = head.map_size(); fields; --fields) {
          auto field = head.text();
          if (auto value = head.field())
            record_->fields.emplace(std::move(field), std::move(*value));
        }
      } else if (auto value = head.field()) {
        if (key == "name") record_->name = std::get<std::string>(*value);
        if (key == "size") record_->size = std::get<std::int64_t>(*value);
      }
    }
    return record_.get();
  }

  // One output record.
  void write(std::string_view name, std::string_view data, const Fields& fields = {}) {
    begin(name, data.size(), fields);
    append(data);
  }

  // An output record in parts: `begin` and then `append` as often as needed. With a size exactly
  // that many bytes must come before the next record.
  void begin(std::string_view name, std::optional<std::uint64_t> size, const Fields& fields = {}) {
    std::string head;
    detail::pack_map(head, 3);
    put(head, "name", name);
    detail::pack_string(head, "size");
    if (size) {
      detail::pack_int(head, static_cast<std::int64_t>(*size));
    } else {
      head += '\xC0';
    }
    detail::pack_string(head, "fields");
    detail::pack_fields(head, fields);
    send(detail::kFile, head);
    ++files_;
  }

  void append(std::string_view data) {
    bytes_ += data.size();
    for (; !data.empty(); data.remove_prefix(std::min(data.size(), detail::kMaxPayload)))
      send(detail::kData, data.substr(0, detail::kMaxPayload));
  }

  // Ends the output; the program's exit status: 1 where input is left that nobody asked for.
  int close() {
    std::string end;
    if (!ended_) {
      detail::pack_map(end, 2);
      put(end, "reason", "InputLeft");
      put(end, "message", "the program ended before it had asked for all its records");
      send(detail::kAbort, end);
    } else {
      detail::pack_map(end, 4);
      put(end, "files", files_);
      put(end, "bytes", bytes_);
      put(end, "digest", output_digest_);
      put(end, "input", input_digest_);
      send(detail::kEnd, end);
    }
    flush();
    return ended_ ? 0 : 1;
  }

  // Hands over what was written so far. Waiting for input and `close` do it as well.
  void flush() {
    put_out(pending_);
    pending_.clear();
  }

 private:
  friend class Record;

  static void put(std::string& out, std::string_view key, std::string_view value) {
    detail::pack_string(out, key);
    detail::pack_string(out, value);
  }
  static void put(std::string& out, std::string_view key, std::uint64_t value) {
    detail::pack_string(out, key);
    detail::pack_int(out, static_cast<std::int64_t>(value));
  }

  void send(detail::Type kind, std::string_view payload) {
    if (payload.size() > detail::kMaxPayload) throw Error("name and fields are above 1 MiB");
    std::array<char, detail::kHeader> head{'B', 'P', 'I', 'P', 1, static_cast<char>(kind)};
    detail::put_little(&head[8], static_cast<std::uint32_t>(payload.size()));
    detail::put_little(&head[12], out_sequence_++);
    const auto begun = detail::crc(0, head.data(), 16);
    const auto checksum = detail::crc(begun, payload.data(), payload.size());
    detail::put_little(&head[16], checksum);
    output_digest_ = detail::crc(output_digest_, &head[16], 4);
    pending_.append(head.data(), head.size());
    if (payload.size() < detail::kDirect) {
      pending_.append(payload);
      if (pending_.size() >= detail::kFlush) flush();
    } else {
      flush();
      put_out(payload);
    }
  }

  void put_out(std::string_view data) {
    while (!data.empty()) {
      const auto count = ::write(output_, data.data(), data.size());
      if (count < 0 && errno != EINTR) throw Error("the worker has left the pipe");
      if (count > 0) data.remove_prefix(static_cast<std::size_t>(count));
    }
  }

  void need_frame() {
    if (!put_back_ && !next_frame()) throw Error("the worker left before the end of its records");
    put_back_ = false;
    if (kind_ == detail::kAbort) throw Error("the worker gave up");
  }

  // The next frame into kind_ and payload_; false at the end of the stream.
  bool next_frame() {
    if (!fill(detail::kHeader)) return false;
    const char* head = &buffer_[begin_];
    const std::size_t length = detail::get_little(head + 8);
    kind_ = static_cast<std::uint8_t>(head[5]);
    const bool known = std::memcmp(head, "BPIP\x01", 5) == 0 && !head[6] && !head[7] &&
                       kind_ >= detail::kHello && kind_ <= detail::kAbort &&
                       detail::get_little(head + 12) == in_sequence_;
    if (!known || length > detail::kMaxPayload || (kind_ == detail::kData && !length))
      throw Error("the input holds bytes that are no frame of this session");
    if (!fill(detail::kHeader + length)) throw Error("the input is cut in a frame");
    head = &buffer_[begin_];
    payload_ = {head + detail::kHeader, length};
    const auto checksum = detail::crc(detail::crc(0, head, 16), payload_.data(), length);
    if (checksum != detail::get_little(head + 16))
      throw Error("a frame of the input is damaged");
    if (kind_ != detail::kEnd) input_digest_ = detail::crc(input_digest_, head + 16, 4);
    begin_ += detail::kHeader + length;
    ++in_sequence_;
    return true;
  }

  bool fill(std::size_t least) {
    while (end_ - begin_ < least) {
      if (begin_ == end_) begin_ = end_ = 0;
      if (buffer_.size() - begin_ < least) {
        std::memmove(&buffer_[0], &buffer_[begin_], end_ - begin_);
        end_ -= begin_;
        begin_ = 0;
      }
      flush();
      const auto count = ::read(input_, &buffer_[end_], buffer_.size() - end_);
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) throw Error("stdin can't be read");
      if (count == 0) {
        if (end_ > begin_) throw Error("the input is cut in a frame");
        return false;
      }
      end_ += static_cast<std::size_t>(count);
    }
    return true;
  }

  std::uint64_t number_of(std::string_view wanted) {
    detail::Reader map(payload_);
    for (auto left = map.map_size(); left; --left) {
      const auto key = map.text();
      const auto value = map.field();
      if (key == wanted && value && std::holds_alternative<std::int64_t>(*value))
        return static_cast<std::uint64_t>(std::get<std::int64_t>(*value));
    }
    throw Error("a frame lacks a number that it must have");
  }

  int input_ = -1, output_ = -1;
  std::string buffer_, pending_;
  std::size_t begin_ = 0, end_ = 0;
  std::string_view payload_;
  std::uint8_t kind_ = 0;
  bool put_back_ = false, ended_ = false;
  std::uint32_t in_sequence_ = 0, out_sequence_ = 0, input_digest_ = 0, output_digest_ = 0;
  std::uint64_t files_ = 0, bytes_ = 0;
  std::unique_ptr<Record> record_;
};

inline std::string_view Record::piece() {
  if (ended_ || (size && taken_ == *size)) {
    ended_ = true;
    return {};
  }
  pipe_->need_frame();
  if (pipe_->kind_ == detail::kData) {
    taken_ += pipe_->payload_.size();
    return pipe_->payload_;
  }
  if (size) throw Error("record " + name + " ends too early");
  pipe_->put_back_ = true;
  ended_ = true;
  return {};
}

}  // namespace binpipe
