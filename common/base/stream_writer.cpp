// SPDX-License-Identifier: Apache-2.0
#include "common/base/stream_writer.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <climits>
#include <csignal>
#include <cstring>
#include <string_view>
#include <utility>

namespace cairn {
namespace {

using std::chrono::milliseconds;
using std::chrono::steady_clock;

constexpr milliseconds kSlice(50);          ///< between two looks at what has been asked for meanwhile
constexpr milliseconds kRetryAfter(1'000);  ///< a write that the system refused
constexpr mode_t kMode = 0666;
constexpr const char* kNobodyReads = "nobody reads it";
constexpr const char* kTooSlow = "what reads it does not keep up";

std::string why_not(int error) {
  return std::string("cannot be written: ") + std::strerror(error);
}

/// The shell has opened these, and truncated them where it was to.
bool is_open_already(const std::filesystem::path& path) {
  const std::string text = path.string();
  return text == "/dev/stdout" || text == "/dev/stderr" || text.starts_with("/dev/fd/") ||
         text.starts_with("/proc/self/fd/");
}

constexpr int kWithoutWaiting = O_WRONLY | O_NONBLOCK | O_CLOEXEC | O_NOCTTY;

/// Opens a file or stream to write, without waiting for a reader. -1 and errno where it cannot be opened.
int open_to_write(const std::filesystem::path& path) {
  const int how = is_open_already(path) ? O_APPEND : O_CREAT | O_TRUNC;
  return ::open(path.c_str(), kWithoutWaiting | how, kMode);
}

bool has_mode(int found, mode_t wanted, const struct stat& about) {
  return found == 0 && (about.st_mode & S_IFMT) == wanted;
}

/// Signals are for the threads that ask for them; SIGPIPE is an error of the write.
void block_all_signals() {
  sigset_t all;
  sigfillset(&all);
  pthread_sigmask(SIG_BLOCK, &all, nullptr);
}

}  // namespace

Result<std::unique_ptr<StreamWriter>> StreamWriter::open(const std::filesystem::path& path,
                                                         size_t queue_bytes) {
  const int descriptor = open_to_write(path);
  const int error = errno;
  struct stat about {};
  const int found = descriptor < 0 ? stat(path.c_str(), &about) : fstat(descriptor, &about);
  const bool awaits_reader = descriptor < 0 && error == ENXIO && has_mode(found, S_IFIFO, about);
  if (descriptor < 0 && !awaits_reader) return fail(ErrorCode::kIo, path.string() + ": " + why_not(error));
  const Kind kind = has_mode(found, S_IFREG, about) ? Kind::kFile : Kind::kNonBlocking;
  return std::unique_ptr<StreamWriter>(
      new StreamWriter(path.string(), descriptor, kind, false, queue_bytes));  // NOLINT: private
}

/// O_NONBLOCK belongs to what processes share: a pipe or terminal is opened anew to have one of its own.
std::unique_ptr<StreamWriter> StreamWriter::of_descriptor(int descriptor, std::string name,
                                                          size_t queue_bytes) {
  struct stat about {};
  const int found = fstat(descriptor, &about);
  Kind kind = Kind::kBlocking;
  int own = -1;
  if (has_mode(found, S_IFREG, about)) {
    kind = Kind::kFile;
  } else if (has_mode(found, S_IFSOCK, about)) {
    kind = Kind::kSocket;
  } else if (own = open_to_write("/proc/self/fd/" + std::to_string(descriptor)); own >= 0) {
    kind = Kind::kNonBlocking;
  }
  if (own < 0) own = fcntl(descriptor, F_DUPFD_CLOEXEC, 0);
  std::unique_ptr<StreamWriter> writer(
      new StreamWriter(std::move(name), own, kind, true, queue_bytes));  // NOLINT: private
  writer->given_up_ = own < 0;
  return writer;
}

StreamWriter::StreamWriter(std::string name, int descriptor, Kind kind, bool writes_directly,
                           size_t queue_bytes)
    : name_(std::move(name)),
      writes_directly_(writes_directly),
      queue_bytes_(queue_bytes),
      kind_(kind),
      descriptor_(descriptor) {}

StreamWriter::~StreamWriter() {
  if (!done_) (void)finish({milliseconds(0), milliseconds(0)});
}

bool StreamWriter::write(std::string row) {
  const std::lock_guard lock(mutex_);
  ++rows_;
  if (!given_up_ && queue_.empty() && writes_directly_ && write_directly(row)) return true;
  if (given_up_ || (!queue_.empty() && queued_bytes_ + row.size() > queue_bytes_)) {
    ++rows_left_out_;
    note_fault(kTooSlow);
    return false;
  }
  queued_bytes_ += row.size();
  queue_.push_back(std::move(row));
  if (!thread_.joinable()) thread_ = std::thread([this] { run(); });
  changed_.notify_all();
  return true;
}

/// Whether all of it is written. What is left of it is for the thread.
bool StreamWriter::write_directly(const std::string& row) {
  while (front_written_ < row.size()) {
    const ssize_t count = write_some(row.data() + front_written_, row.size() - front_written_);
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) return false;
    front_written_ += static_cast<size_t>(count);
  }
  front_written_ = 0;
  return true;
}

/// Writes as write(2) does, but fails with EAGAIN where that would wait.
ssize_t StreamWriter::write_some(const char* bytes, size_t count) const {
  if (kind_ == Kind::kSocket) return send(descriptor_, bytes, count, MSG_DONTWAIT | MSG_NOSIGNAL);
  if (kind_ == Kind::kBlocking) {
    // So much does not wait once there is room.
    pollfd room{descriptor_, POLLOUT, 0};
    if (poll(&room, 1, 0) == 0) {
      errno = EAGAIN;
      return -1;
    }
    count = std::min<size_t>(count, PIPE_BUF);
  }
  return ::write(descriptor_, bytes, count);
}

Status StreamWriter::status() const {
  const std::lock_guard lock(mutex_);
  return fault_;
}

void StreamWriter::note_fault(const std::string& why) {
  if (fault_) fault_ = fail(ErrorCode::kIo, name_ + ": " + why);
}

void StreamWriter::run() {
  block_all_signals();
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return finishing_ || given_up_ || !queue_.empty(); });
    if (given_up_ || queue_.empty()) {
      if (finishing_) break;
      rows_left_out_ += queue_.size();
      queue_.clear();
      changed_.wait(lock, [this] { return finishing_; });
      break;
    }
    step(lock);
  }
  done_ = true;
  changed_.notify_all();
}

/// One attempt to write the first row, without the lock.
void StreamWriter::step(std::unique_lock<std::mutex>& lock) {
  const std::string& row = queue_.front();  // stays where it is while others come behind it
  const size_t begin = front_written_;
  lock.unlock();
  if (descriptor_ < 0) descriptor_ = ::open(name_.c_str(), kWithoutWaiting);  // of open(), a FIFO
  const ssize_t count = descriptor_ < 0 ? -1 : write_some(row.data() + begin, row.size() - begin);
  const int error = errno;
  const bool is_full = count < 0 && error == EAGAIN;
  if (is_full) {
    pollfd room{descriptor_, POLLOUT, 0};
    (void)poll(&room, 1, static_cast<int>(kSlice.count()));
  }
  lock.lock();
  if (count >= 0) {
    advance(static_cast<size_t>(count));
  } else if (!is_full && error != EINTR) {
    handle_error(error, lock);
  }
}

void StreamWriter::advance(size_t bytes) {
  front_written_ += bytes;
  bytes_written_ += bytes;
  if (front_written_ < queue_.front().size()) return;
  queued_bytes_ -= queue_.front().size();
  queue_.pop_front();
  front_written_ = 0;
  changed_.notify_all();
}

void StreamWriter::handle_error(int error, std::unique_lock<std::mutex>& lock) {
  const auto ends = [this] { return finishing_ || given_up_; };
  if (descriptor_ < 0 && error == ENXIO) {  // no reader yet
    changed_.wait_for(lock, kSlice, [this] { return given_up_; });
    return;
  }
  note_fault(why_not(error));
  if (error == EPIPE || finishing_ || kind_ != Kind::kFile) {
    given_up_ = true;
    return;
  }
  changed_.wait_for(lock, kRetryAfter, ends);
}

Status StreamWriter::finish(DrainPatience patience, const std::function<bool()>& stop_requested) {
  const bool was_stopped = stop_requested();
  std::unique_lock lock(mutex_);
  finishing_ = true;
  done_ = !thread_.joinable();
  changed_.notify_all();
  const auto begin = steady_clock::now();
  auto last_progress = begin;
  auto written = bytes_written_;
  while (!done_) {
    lock.unlock();
    const bool stops = stop_requested() && !was_stopped;
    lock.lock();
    const auto now = steady_clock::now();
    if (std::exchange(written, bytes_written_) != bytes_written_) last_progress = now;
    const bool is_over =
        stops || now - last_progress >= patience.without_progress || now - begin >= patience.in_all;
    given_up_ = given_up_ || (is_over && kind_ != Kind::kFile);
    changed_.notify_all();
    changed_.wait_for(lock, kSlice, [this] { return done_; });
  }
  lock.unlock();
  if (thread_.joinable()) thread_.join();
  rows_left_out_ += queue_.size();
  if (!queue_.empty()) note_fault(descriptor_ < 0 ? kNobodyReads : kTooSlow);
  queue_.clear();
  if (descriptor_ >= 0 && close(descriptor_) != 0 && rows_left_out_ == 0)
    return fail(ErrorCode::kIo, name_ + ": " + why_not(errno));
  descriptor_ = -1;
  if (rows_left_out_ == 0) return {};
  const std::string missing =
      rows_ == 1 ? "not complete"
                 : std::to_string(rows_left_out_) + " of " + std::to_string(rows_) + " rows are missing";
  return fail(ErrorCode::kIo, fault_.error().message + "; " + missing);
}

Status write_stream(const std::filesystem::path& path, std::string bytes) {
  auto stream = StreamWriter::open(path);
  if (!stream) return tl::unexpected(stream.error());
  if (!(*stream)->write(std::move(bytes))) return (*stream)->status();
  return (*stream)->finish();
}

}  // namespace cairn
