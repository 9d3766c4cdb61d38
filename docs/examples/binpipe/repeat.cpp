// As repeat.py: as many copies of each record as its field `copies` says.
#include <csignal>
#include <cstdlib>
#include <iostream>

#include "binpipe.hpp"

static std::int64_t number(const binpipe::Fields& fields, const char* key, std::int64_t otherwise) {
  const auto found = fields.find(key);
  return found == fields.end() ? otherwise : std::get<std::int64_t>(found->second);
}

int main() {
  binpipe::Pipe pipe;
  while (auto* record = pipe.next()) {
    // It reaches stderr: the Pipe keeps stdout for the frames.
    std::cout << "got " << record->name << std::endl;
    if (record->fields.count("exit")) {
      std::cerr << "leaving early" << std::endl;
      std::_Exit(static_cast<int>(number(record->fields, "exit", 0)));
    }
    if (record->fields.count("signal"))
      std::raise(static_cast<int>(number(record->fields, "signal", 0)));
    const std::string data = record->read();
    binpipe::Fields fields = record->fields;
    fields.erase("copies");
    fields["bytes_in"] = static_cast<std::int64_t>(data.size());
    const auto copies = number(record->fields, "copies", 1);
    for (std::int64_t copy = 0; copy < copies; ++copy) {
      const std::string name = record->name + "#" + std::to_string(copy);
      if (fields.count("stream")) {
        pipe.begin(name, std::nullopt, fields);
        pipe.append(data);
      } else {
        pipe.write(name, data, fields);
      }
    }
  }
  return pipe.close();
}
