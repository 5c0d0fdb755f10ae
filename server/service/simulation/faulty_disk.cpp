// SPDX-License-Identifier: Apache-2.0
#include "server/service/simulation/faulty_disk.h"

namespace cairn::simulation {
namespace {

constexpr const char* kName = "cairn-faulty-disk";

}  // namespace

/// An open file as SQLite allocates it: the real file lies behind.
struct FaultyDisk::File {
  sqlite3_file base;
  FaultyDisk* disk;

  static File& of(sqlite3_file* file) { return *reinterpret_cast<File*>(file); }
  static sqlite3_file* real(sqlite3_file* file) {
    return reinterpret_cast<sqlite3_file*>(reinterpret_cast<char*>(file) + sizeof(File));
  }
};

FaultyDisk::FaultyDisk() : real_(sqlite3_vfs_find(nullptr)), vfs_(*real_) {
  vfs_.szOsFile = static_cast<int>(sizeof(File)) + real_->szOsFile;
  vfs_.pNext = nullptr;
  vfs_.zName = kName;
  vfs_.pAppData = this;  // of the functions taken over as they are, none uses it
  vfs_.xOpen = &FaultyDisk::open;
  vfs_.xDelete = &FaultyDisk::remove;
  sqlite3_vfs_register(&vfs_, 1);
}

FaultyDisk::~FaultyDisk() {
  sqlite3_vfs_unregister(&vfs_);
  sqlite3_vfs_register(real_, 1);
}

FaultyDisk& FaultyDisk::of(sqlite3_vfs* vfs) {
  return *static_cast<FaultyDisk*>(vfs->pAppData);
}

int FaultyDisk::write_code() {
  if (is_cut()) return SQLITE_IOERR_WRITE;
  if (writes_left_) --*writes_left_;
  return is_full_ ? SQLITE_FULL : SQLITE_OK;
}

int FaultyDisk::open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  FaultyDisk& disk = of(vfs);
  File::of(file).base.pMethods = nullptr;
  File::of(file).disk = &disk;
  const int code = disk.real_->xOpen(disk.real_, name, File::real(file), flags, out_flags);
  if (File::real(file)->pMethods != nullptr) File::of(file).base.pMethods = methods();
  return code;
}

int FaultyDisk::remove(sqlite3_vfs* vfs, const char* name, int sync_directory) {
  FaultyDisk& disk = of(vfs);
  if (disk.is_cut()) return SQLITE_IOERR_DELETE;
  return disk.real_->xDelete(disk.real_, name, sync_directory);
}

const sqlite3_io_methods* FaultyDisk::methods() {
  static const sqlite3_io_methods kMethods = [] {
    sqlite3_io_methods m{};
    m.iVersion = 2;
    m.xClose = [](sqlite3_file* f) { return File::real(f)->pMethods->xClose(File::real(f)); };
    m.xRead = [](sqlite3_file* f, void* data, int size, sqlite3_int64 at) {
      return File::real(f)->pMethods->xRead(File::real(f), data, size, at);
    };
    m.xWrite = [](sqlite3_file* f, const void* data, int size, sqlite3_int64 at) {
      const int code = File::of(f).disk->write_code();
      return code != SQLITE_OK ? code : File::real(f)->pMethods->xWrite(File::real(f), data, size, at);
    };
    m.xTruncate = [](sqlite3_file* f, sqlite3_int64 size) {
      if (File::of(f).disk->is_cut()) return SQLITE_IOERR_TRUNCATE;
      return File::real(f)->pMethods->xTruncate(File::real(f), size);
    };
    m.xSync = [](sqlite3_file* f, int) {  // a process that is killed takes no page from the system's memory
      return File::of(f).disk->is_cut() ? SQLITE_IOERR_FSYNC : SQLITE_OK;
    };
    m.xFileSize = [](sqlite3_file* f, sqlite3_int64* size) {
      return File::real(f)->pMethods->xFileSize(File::real(f), size);
    };
    m.xLock = [](sqlite3_file* f, int lock) { return File::real(f)->pMethods->xLock(File::real(f), lock); };
    m.xUnlock = [](sqlite3_file* f, int lock) {
      return File::real(f)->pMethods->xUnlock(File::real(f), lock);
    };
    m.xCheckReservedLock = [](sqlite3_file* f, int* is_held) {
      return File::real(f)->pMethods->xCheckReservedLock(File::real(f), is_held);
    };
    m.xFileControl = [](sqlite3_file* f, int what, void* argument) {
      return File::real(f)->pMethods->xFileControl(File::real(f), what, argument);
    };
    m.xSectorSize = [](sqlite3_file* f) { return File::real(f)->pMethods->xSectorSize(File::real(f)); };
    m.xDeviceCharacteristics = [](sqlite3_file* f) {
      return File::real(f)->pMethods->xDeviceCharacteristics(File::real(f));
    };
    m.xShmMap = [](sqlite3_file* f, int page, int size, int extend, void volatile** at) {
      return File::real(f)->pMethods->xShmMap(File::real(f), page, size, extend, at);
    };
    m.xShmLock = [](sqlite3_file* f, int offset, int n, int flags) {
      return File::real(f)->pMethods->xShmLock(File::real(f), offset, n, flags);
    };
    m.xShmBarrier = [](sqlite3_file* f) { File::real(f)->pMethods->xShmBarrier(File::real(f)); };
    m.xShmUnmap = [](sqlite3_file* f, int remove) {
      return File::real(f)->pMethods->xShmUnmap(File::real(f), remove);
    };
    return m;
  }();
  return &kMethods;
}

}  // namespace cairn::simulation
