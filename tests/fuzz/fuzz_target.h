// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

/// A decoder as libFuzzer calls it, and as replay.cpp does with the inputs that are kept. Each target is a
/// program of its own that defines decode() and seeds().
namespace cairn::fuzz {

using Bytes = std::span<const uint8_t>;
using Input = std::vector<uint8_t>;

/// Shows the bytes to the decoder. It may refuse them; it may not crash, hang, or take what it would not
/// write itself. What it takes and must not ends the process with abort().
void decode(Bytes bytes);

/// Sound inputs to begin with, made by the product's own encoders.
[[nodiscard]] std::vector<Input> seeds();

/// abort() with the reason, when a law of the decoder does not hold.
void demand(bool holds, const char* law);
void demand(bool holds, const std::string& law);

/// A file in memory that is there until the end of its scope, for decoders that read files.
class MemoryFile {
 public:
  explicit MemoryFile(Bytes bytes);
  ~MemoryFile();
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  [[nodiscard]] std::filesystem::path path() const;

 private:
  int descriptor_;
};

/// A folder of this process that is there until it ends, in memory where the machine has /dev/shm, for what
/// is looked for under a name.
class OwnFolder {
 public:
  OwnFolder();
  ~OwnFolder();
  OwnFolder(const OwnFolder&) = delete;
  OwnFolder& operator=(const OwnFolder&) = delete;
  [[nodiscard]] const std::filesystem::path& path() const { return path_; }
  /// In place of what was there under that name.
  void write(const std::filesystem::path& name, Bytes bytes) const;

 private:
  std::filesystem::path path_;
};

[[nodiscard]] inline Bytes bytes_of(std::string_view text) {
  return {reinterpret_cast<const uint8_t*>(text.data()), text.size()};
}
[[nodiscard]] inline std::string_view text_of(Bytes bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
[[nodiscard]] inline Input copy_of(std::string_view text) {
  const auto bytes = bytes_of(text);
  return {bytes.begin(), bytes.end()};
}
/// Of a target with several decoders: the first byte says which.
[[nodiscard]] Input input_of(size_t decoder, Bytes bytes);
[[nodiscard]] inline Input input_of(size_t decoder, std::string_view text) {
  return input_of(decoder, bytes_of(text));
}

}  // namespace cairn::fuzz
