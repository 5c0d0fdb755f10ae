// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <optional>

namespace cairn::simulation {

/// The disk under all databases of this process that are opened while it is there: it can be full, or be cut
/// off in the middle of a commit, as when the process is killed there. It does not wait for the medium. One
/// at a time: SQLite has one default for all.
class FaultyDisk {
 public:
  FaultyDisk();
  ~FaultyDisk();
  FaultyDisk(const FaultyDisk&) = delete;
  FaultyDisk& operator=(const FaultyDisk&) = delete;

  void set_full(bool full) { is_full_ = full; }
  /// After so many more writes nothing is written any more.
  void cut_after(uint64_t writes) { writes_left_ = writes; }
  void cut() { writes_left_ = 0; }
  /// Makes the disk work again, for another process that opens what is left.
  void mend() {
    writes_left_.reset();
    is_full_ = false;
  }
  [[nodiscard]] bool is_cut() const { return writes_left_ == 0; }

 private:
  struct File;
  static FaultyDisk& of(sqlite3_vfs* vfs);
  /// SQLITE_OK: it may be written.
  [[nodiscard]] int write_code();
  static int open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags);
  static int remove(sqlite3_vfs* vfs, const char* name, int sync_directory);
  static const sqlite3_io_methods* methods();

  sqlite3_vfs* const real_;
  sqlite3_vfs vfs_;
  bool is_full_ = false;
  std::optional<uint64_t> writes_left_;
};

}  // namespace cairn::simulation
