// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "common/base/result.h"

struct sqlite3;
struct sqlite3_stmt;

/// RAII over SQLite's C API, as much of it as the store needs. One thread at a time per database.
namespace cairn::sqlite {

/// A prepared statement; columns and parameters count from 0. Lives shorter than its database.
class Statement {
 public:
  Statement& bind(int index, int64_t value);
  Statement& bind(int index, std::string_view text);
  Statement& bind(int index, std::span<const uint8_t> blob);  ///< borrowed until the next reset()

  /// Steps to the next row. Returns false at the end.
  [[nodiscard]] Result<bool> step();
  /// Runs a statement without rows, then resets it.
  [[nodiscard]] Status run();
  void reset();

  [[nodiscard]] int64_t integer(int column) const;
  [[nodiscard]] std::string text(int column) const;
  [[nodiscard]] std::span<const uint8_t> blob(int column) const;  ///< until the next step or reset

 private:
  friend class Database;
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const;
  };
  Statement(sqlite3_stmt* statement, const std::string* path) : statement_(statement), path_(path) {}
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  const std::string* path_;
};

enum class OpenMode : uint8_t {
  kCreate,
  kReadWrite,
  kBeside,  ///< as kReadWrite, while others have it open and may move it: its log is left to them
  kAtRest,  ///< to be read, of a file without a log that nobody changes: nothing is written, not beside it
            ///< either
};

class Database {
 public:
  /// WAL and synchronous=FULL: what commit() has said is there after a loss of power. A file from elsewhere
  /// is not trusted (no functions in schemas, cell sizes checked). Errors: kNotFound, kIo, kDamaged (no
  /// database, or a broken one).
  [[nodiscard]] static Result<Database> open(const std::filesystem::path& path, OpenMode mode);

  /// One or more statements without results.
  [[nodiscard]] Status execute(const std::string& sql);
  [[nodiscard]] Result<Statement> prepare(std::string_view sql);
  /// The single number that a query gives.
  [[nodiscard]] Result<int64_t> number(std::string_view sql);

  /// Writes what has been committed from the log to the file, durably. Error kIo: not all of it, which is no
  /// loss: it stays in the log.
  [[nodiscard]] Status checkpoint();
  /// A copy in one file, consistent and compact. `path` must not exist. Error kIo, with that name and why.
  [[nodiscard]] Status copy_to(const std::filesystem::path& path);
  /// Pages in the log since it was last written back.
  [[nodiscard]] int log_pages() const;

  [[nodiscard]] const std::string& path() const { return *path_; }

 private:
  struct Close {
    void operator()(sqlite3* database) const;
  };
  Database(std::unique_ptr<sqlite3, Close> database, std::unique_ptr<const std::string> path)
      : path_(std::move(path)), database_(std::move(database)) {}
  std::unique_ptr<const std::string> path_;  ///< statements point to it
  std::unique_ptr<int> log_pages_ = std::make_unique<int>(0);
  std::unique_ptr<sqlite3, Close> database_;
};

/// While it lives, all that is read is as of one moment, whoever else writes the file.
class Reading {
 public:
  [[nodiscard]] static Result<Reading> begin(Database* database);
  Reading(Reading&& other) noexcept : database_(std::exchange(other.database_, nullptr)) {}
  Reading& operator=(Reading&&) = delete;
  ~Reading();

 private:
  explicit Reading(Database* database) : database_(database) {}
  Database* database_;
};

/// Rolls back unless committed. A failed commit is rolled back too.
class Transaction {
 public:
  /// Takes the write lock at once.
  [[nodiscard]] static Result<Transaction> begin(Database* database);
  Transaction(Transaction&& other) noexcept : database_(std::exchange(other.database_, nullptr)) {}
  Transaction& operator=(Transaction&&) = delete;
  ~Transaction();
  [[nodiscard]] Status commit();

 private:
  explicit Transaction(Database* database) : database_(database) {}
  Database* database_;
};

/// Whether an error means that the medium takes nothing more for now: full, over quota, read-only, failing;
/// or that memory is short.
[[nodiscard]] bool is_write_failure(const Error& error);

}  // namespace cairn::sqlite
