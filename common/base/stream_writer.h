// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>

#include "common/base/result.h"

namespace cairn {

/// How long the end of a program waits for a reader that is slow.
struct DrainPatience {
  std::chrono::milliseconds without_progress{2'000};  ///< since a byte was last taken
  std::chrono::milliseconds in_all{10'000};
};

/// Rows to a file, a pipe, a socket or a terminal, whole and in order. Whoever hands them over never waits
/// for the reader: a thread of the writer's own does. A row that finds no room in the queue is left out, and
/// so is what a reader has not taken at the end. A regular file is waited for as long as it takes. A write
/// that the system refuses (a full disk) is tried again every second. write() and status() may be called from
/// any thread.
class StreamWriter {
 public:
  static constexpr size_t kQueueBytes = size_t{4} << 20;

  /// Creates the file or truncates what is there; /dev/stdout and /dev/fd/N are gone on with where they are.
  /// A FIFO that nobody reads is opened as soon as somebody does. Error kIo.
  [[nodiscard]] static Result<std::unique_ptr<StreamWriter>> open(const std::filesystem::path& path,
                                                                  size_t queue_bytes = kQueueBytes);
  /// A stream that the process has already, such as stderr; `name` is for messages. What can be written at
  /// once is written in the caller's thread, so that nothing is lost in a crash and the order with other
  /// writers holds; a regular file always is.
  [[nodiscard]] static std::unique_ptr<StreamWriter> of_descriptor(int descriptor, std::string name,
                                                                   size_t queue_bytes = kQueueBytes);
  /// Without finish(), a regular file gets what is queued, everything else is given up.
  ~StreamWriter();
  StreamWriter(const StreamWriter&) = delete;
  StreamWriter& operator=(const StreamWriter&) = delete;

  /// Takes a row, or leaves it out (false). One row is always taken, however long it is.
  [[nodiscard]] bool write(std::string row);
  /// The first fault so far: a row left out, or a write that the system refused. It may have passed since.
  [[nodiscard]] Status status() const;
  /// Waits until all is written, for a reader no longer than `patience`, and closes the stream.
  /// `stop_requested` is asked meanwhile; a request that comes then ends the waiting for a reader. Error kIo
  /// where anything is missing, with the number of rows. Call once, write() no more.
  [[nodiscard]] Status finish(
      DrainPatience patience = {}, const std::function<bool()>& stop_requested = [] { return false; });

 private:
  enum class Kind : uint8_t { kFile, kNonBlocking, kSocket, kBlocking };
  StreamWriter(std::string name, int descriptor, Kind kind, bool writes_directly, size_t queue_bytes);

  void run();
  void step(std::unique_lock<std::mutex>& lock);
  void handle_error(int error, std::unique_lock<std::mutex>& lock);
  void advance(size_t bytes);
  [[nodiscard]] bool write_directly(const std::string& row);
  [[nodiscard]] ssize_t write_some(const char* bytes, size_t count) const;
  void note_fault(const std::string& why);

  const std::string name_;
  const bool writes_directly_;
  const size_t queue_bytes_;
  const Kind kind_;
  int descriptor_;  ///< -1: a FIFO that nobody reads yet; of the thread, once it runs

  mutable std::mutex mutex_;
  std::condition_variable changed_;
  // Guarded by mutex_.
  std::deque<std::string> queue_;  ///< the first one is being written
  size_t queued_bytes_ = 0;        ///< of rows not yet complete
  size_t front_written_ = 0;       ///< [bytes] of the first row
  uint64_t bytes_written_ = 0;
  uint64_t rows_ = 0;
  uint64_t rows_left_out_ = 0;
  bool finishing_ = false;
  bool given_up_ = false;  ///< nothing is written any more
  bool done_ = false;      ///< the thread is
  Status fault_;
  std::thread thread_;  ///< begun with the first row that has to wait
};

/// Writes all of `bytes` to `path`, which may be a pipe: a StreamWriter from beginning to end. Error kIo.
[[nodiscard]] Status write_stream(const std::filesystem::path& path, std::string bytes);

}  // namespace cairn
