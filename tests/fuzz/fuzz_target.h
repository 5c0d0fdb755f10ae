// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

/// A decoder as libFuzzer calls it, and as replay.cpp does with the inputs that are kept. Each target is a
/// program of its own that defines these.
namespace cairn::fuzz {

/// Shows the bytes to the decoder. It may refuse them; it may not crash, hang, or take what it would not
/// write itself. What it takes and must not ends the process with abort().
void decode(std::span<const uint8_t> bytes);

/// Sound inputs to begin with, made by the product's own encoders.
[[nodiscard]] std::vector<std::vector<uint8_t>> seeds();

/// abort() with the reason, when a law of the decoder does not hold.
void demand(bool holds, const char* law);

/// A file in memory that is there until the end of its scope, for decoders that read files.
class MemoryFile {
 public:
  explicit MemoryFile(std::span<const uint8_t> bytes);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] std::filesystem::path path() const;

 private:
  int descriptor_;
};

[[nodiscard]] inline std::span<const uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}
[[nodiscard]] inline std::vector<uint8_t> copy_of(std::string_view text) {
  const auto bytes = bytes_of(text);
  return {bytes.begin(), bytes.end()};
}

}  // namespace cairn::fuzz
