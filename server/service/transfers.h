// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "common/base/result.h"
#include "common/base/time.h"

namespace cairn {

/// Archives on their way to or from operators, as files in a folder of their own. Few at a time; one that
/// nobody has touched for a while goes, so that what is left behind does not fill the disk. The time is
/// handed in. Used from one thread.
class Transfers {
 public:
  static constexpr size_t kMost = 8;
  static constexpr std::chrono::minutes kPatience{10};
  static constexpr uint64_t kMostBytes = uint64_t{1} << 34;  ///< of one

  explicit Transfers(std::filesystem::path folder) : folder_(std::move(folder)) {}
  ~Transfers();
  Transfers(const Transfers&) = delete;
  Transfers& operator=(const Transfers&) = delete;

  /// A token for a file that is about to be written at path_of(). Error kRefused: too many under way.
  [[nodiscard]] Result<std::string> begin_export(MonotonicTime now);
  /// An empty file under the operator's token; one that is there already is begun anew. Errors: kUsage (not a
  /// token), kRefused, kIo.
  [[nodiscard]] Status begin_import(const std::string& token, MonotonicTime now);

  /// At most `most` bytes from an offset on; empty beyond the end. Once its last byte has been read, the
  /// transfer is over. Error kNotFound.
  [[nodiscard]] Result<std::vector<uint8_t>> read(const std::string& token, uint64_t offset, size_t most,
                                                  MonotonicTime now);
  /// Writes at an offset, so a piece that comes twice does no harm. Errors: kNotFound, kRefused (too large),
  /// kIo, which ends the transfer.
  [[nodiscard]] Status write(const std::string& token, uint64_t offset, std::span<const uint8_t> data,
                             MonotonicTime now);

  /// The file of a transfer that is under way. Error kNotFound.
  [[nodiscard]] Result<std::filesystem::path> find(const std::string& token, MonotonicTime now);
  void end(const std::string& token);
  /// Ends what nobody has touched for kPatience.
  void expire(MonotonicTime now);

 private:
  [[nodiscard]] std::filesystem::path path_of(const std::string& token) const { return folder_ / token; }
  [[nodiscard]] Status make_room(MonotonicTime now);

  const std::filesystem::path folder_;
  std::map<std::string, MonotonicTime> touched_;  ///< those under way
  uint64_t exports_ = 0;
};

}  // namespace cairn
