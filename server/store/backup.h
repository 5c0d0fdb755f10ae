// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"

/// A backup: copies of all files of a store in one tar archive, whose last entry says what it must hold. Any
/// tar lists and unpacks it; this code takes it as whole or not at all.
namespace cairn {

struct BackupPart {
  std::string name;  ///< as below the store's folder: "maps/ID.cairnmap"
  uint64_t bytes = 0;
  uint32_t checksum = 0;  ///< CRC-32
};

struct BackupContent {
  Timestamp made;
  std::string version;  ///< of the program that wrote it
  std::vector<BackupPart> parts;
};

/// Whether a file of a store may be called so.
[[nodiscard]] bool is_backup_part(const std::string& name);
/// Error kDamaged: without rights or without the server's id these are no store, whatever maps there are.
[[nodiscard]] Status check_is_all(std::span<const std::string> parts);

class BackupWriter {
 public:
  /// Readable by its owner only. Errors: kRefused (there is such a file), kIo.
  [[nodiscard]] static Result<BackupWriter> create(const std::filesystem::path& path);
  /// A copy of a file. Error kIo, of either.
  [[nodiscard]] Status add(const std::string& name, const std::filesystem::path& file);
  /// Durable on return; without, it is no backup. Errors: as check_is_all(), kIo.
  [[nodiscard]] Status finish(Timestamp made, const std::string& version);
  [[nodiscard]] const BackupContent& content() const { return content_; }

 private:
  explicit BackupWriter(std::filesystem::path path) : path_(std::move(path)) {}
  [[nodiscard]] Status put(const char* bytes, size_t count);
  [[nodiscard]] Status put_header(const std::string& name, uint64_t bytes);
  [[nodiscard]] Status pad(uint64_t bytes);

  std::filesystem::path path_;
  std::ofstream out_;
  BackupContent content_;
};

/// Is told how much of a backup has been read [byte].
using BackupProgress = std::function<void(uint64_t bytes, uint64_t of)>;
/// Reads all of a backup. `folder`: where its files are written, durably, if anywhere; it must be empty.
/// Errors: kDamaged (no backup, cut off, altered; the part is named, and what has been written is not to be
/// used), kIo.
[[nodiscard]] Result<BackupContent> read_backup(const std::filesystem::path& path,
                                                const std::optional<std::filesystem::path>& folder,
                                                const BackupProgress& progress);

}  // namespace cairn
