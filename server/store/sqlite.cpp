// SPDX-License-Identifier: Apache-2.0
#include "server/store/sqlite.h"

#include <sqlite3.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <utility>

#include "server/store/os_reason.h"

namespace cairn::sqlite {
namespace {

constexpr int kBusyMilliseconds = 5000;  ///< a reader (backup, sqlite3 shell) may hold the file for a moment

/// `said`: by SQLite; `system_error`: the number of the system call that failed, 0 where it is not known.
tl::unexpected<Error> failure(int code, const std::string& path, const std::string& said, int system_error) {
  const auto reason = [&]() -> std::string {
    if (system_error != 0) return std::strerror(system_error);
    std::string why = why_not_writable(path);
    return why.empty() ? said : why;
  };
  switch (code & 0xff) {
    case SQLITE_FULL:
      return fail(ErrorCode::kIo,
                  path + ": disk full (" + std::strerror(ENOSPC) + "); free space there and go on");
    case SQLITE_IOERR:
      return fail(ErrorCode::kIo,
                  path + ": cannot be written or read: " + reason() + "; see to the disk, quota or mount");
    case SQLITE_READONLY:
    case SQLITE_PERM:
    case SQLITE_CANTOPEN:
      return fail(ErrorCode::kIo,
                  path + ": cannot be written: " + reason() + "; see to existence, owner and mount");
    case SQLITE_BUSY:
    case SQLITE_LOCKED: {
      const std::string holder = holder_of_lock(path);
      return fail(ErrorCode::kIo, path + ": locked by " + (holder.empty() ? "another program" : holder) +
                                      "; end that, or wait for it, and try again");
    }
    case SQLITE_NOMEM:
      return fail(ErrorCode::kIo, path + ": no memory");
    case SQLITE_CORRUPT:
    case SQLITE_NOTADB:
    case SQLITE_FORMAT:
      return fail(ErrorCode::kDamaged, path + ": " + said);
    default:
      return fail(ErrorCode::kInternal, path + ": " + said);
  }
}

/// The number of the system call that failed last on the log or the file; 0: not known.
int system_error_of(sqlite3* database) {
  if (const int error = sqlite3_system_errno(database); error != 0) return error;
  int error = 0;
  for (const int which : {SQLITE_FCNTL_JOURNAL_POINTER, SQLITE_FCNTL_FILE_POINTER}) {
    sqlite3_file* file = nullptr;
    if (error == 0 && sqlite3_file_control(database, "main", which, static_cast<void*>(&file)) == SQLITE_OK &&
        file != nullptr && file->pMethods != nullptr)
      file->pMethods->xFileControl(file, SQLITE_FCNTL_LAST_ERRNO, &error);
  }
  return error;
}

/// The error of the last call on `database`.
tl::unexpected<Error> failure(int code, const std::string& path, sqlite3* database) {
  return failure(code, path, sqlite3_errmsg(database), system_error_of(database));
}

/// Else SQLite would lay files beside a database that is only read, which a full disk does not take.
std::string at_rest_uri(const std::string& path) {
  std::string uri = "file:";
  for (const char c : path) {
    if (c == '%' || c == '?' || c == '#') {
      char text[4];
      std::snprintf(text, sizeof(text), "%%%02x", static_cast<unsigned>(c));
      uri += text;
    } else {
      uri += c;
    }
  }
  return uri + "?immutable=1";
}

}  // namespace

// ---- Statement

void Statement::Finalize::operator()(sqlite3_stmt* statement) const {
  sqlite3_finalize(statement);
}

Statement& Statement::bind(int index, int64_t value) {
  sqlite3_bind_int64(statement_.get(), index + 1, value);
  return *this;
}

Statement& Statement::bind(int index, std::string_view text) {
  sqlite3_bind_text64(statement_.get(), index + 1, text.data(), text.size(), SQLITE_TRANSIENT, SQLITE_UTF8);
  return *this;
}

Statement& Statement::bind(int index, std::span<const uint8_t> blob) {
  static constexpr uint8_t kNothing = 0;  // a null pointer would bind NULL
  sqlite3_bind_blob64(statement_.get(), index + 1, blob.empty() ? &kNothing : blob.data(), blob.size(),
                      SQLITE_STATIC);
  return *this;
}

Result<bool> Statement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return failure(code, *path_, sqlite3_db_handle(statement_.get()));
}

Status Statement::run() {
  Result<bool> stepped = step();
  reset();
  if (!stepped) return tl::unexpected(stepped.error());
  return {};
}

void Statement::reset() {
  sqlite3_reset(statement_.get());
  sqlite3_clear_bindings(statement_.get());
}

int64_t Statement::integer(int column) const {
  return sqlite3_column_int64(statement_.get(), column);
}

std::string Statement::text(int column) const {
  const auto* text = reinterpret_cast<const char*>(sqlite3_column_text(statement_.get(), column));
  return text == nullptr
             ? std::string()
             : std::string(text, static_cast<size_t>(sqlite3_column_bytes(statement_.get(), column)));
}

std::span<const uint8_t> Statement::blob(int column) const {
  const auto* data = static_cast<const uint8_t*>(sqlite3_column_blob(statement_.get(), column));
  const auto size = static_cast<size_t>(sqlite3_column_bytes(statement_.get(), column));
  return {data, data == nullptr ? 0 : size};
}

// ---- Database

void Database::Close::operator()(sqlite3* database) const {
  sqlite3_close_v2(database);
}

Result<Database> Database::open(const std::filesystem::path& path, OpenMode mode) {
  auto name = std::make_unique<const std::string>(path.string());
  if (mode != OpenMode::kCreate && !std::filesystem::exists(path)) {
    return fail(ErrorCode::kNotFound, *name + ": no such file");
  }
  const bool at_rest = mode == OpenMode::kAtRest;
  int flags = SQLITE_OPEN_NOMUTEX | SQLITE_OPEN_EXRESCODE;
  flags |= at_rest ? SQLITE_OPEN_READONLY | SQLITE_OPEN_URI : SQLITE_OPEN_READWRITE;
  if (mode == OpenMode::kCreate) flags |= SQLITE_OPEN_CREATE;
  sqlite3* raw = nullptr;
  const std::string source = at_rest ? at_rest_uri(*name) : *name;
  const int code = sqlite3_open_v2(source.c_str(), &raw, flags, nullptr);
  std::unique_ptr<sqlite3, Close> handle(raw);
  if (code != SQLITE_OK)
    return failure(code, *name, sqlite3_errstr(code), raw == nullptr ? 0 : sqlite3_system_errno(raw));
  sqlite3_busy_timeout(raw, kBusyMilliseconds);
  sqlite3_db_config(raw, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  // By the name that the log had when it was opened, which may be another file's by then.
  if (mode == OpenMode::kBeside) sqlite3_db_config(raw, SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, 1, nullptr);
  Database database(std::move(handle), std::move(name));
  // The log is written back by checkpoint(), after the answers have gone out.
  Status prepared = database.execute("PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON;");
  if (prepared && !at_rest)
    prepared =
        database.execute("PRAGMA journal_mode=WAL; PRAGMA synchronous=FULL; PRAGMA wal_autocheckpoint=0;");
  sqlite3_wal_hook(
      raw,
      [](void* pages, sqlite3*, const char*, int count) {
        *static_cast<int*>(pages) = count;
        return SQLITE_OK;
      },
      database.log_pages_.get());
  if (!prepared) return tl::unexpected(prepared.error());
  return database;
}

Status Database::execute(const std::string& sql) {
  const int code = sqlite3_exec(database_.get(), sql.c_str(), nullptr, nullptr, nullptr);
  if (code != SQLITE_OK) return failure(code, *path_, database_.get());
  return {};
}

Result<Statement> Database::prepare(std::string_view sql) {
  sqlite3_stmt* raw = nullptr;
  const int code =
      sqlite3_prepare_v2(database_.get(), sql.data(), static_cast<int>(sql.size()), &raw, nullptr);
  Statement statement(raw, path_.get());
  if (code != SQLITE_OK) return failure(code, *path_, database_.get());
  return statement;
}

Result<int64_t> Database::number(std::string_view sql) {
  Result<Statement> query = prepare(sql);
  if (!query) return tl::unexpected(query.error());
  Result<bool> row = query->step();
  if (!row) return tl::unexpected(row.error());
  if (!*row) return fail(ErrorCode::kDamaged, *path_ + ": a row is missing");
  return query->integer(0);
}

Status Database::checkpoint() {
  int pages = 0;
  int written = 0;
  const int code =
      sqlite3_wal_checkpoint_v2(database_.get(), nullptr, SQLITE_CHECKPOINT_PASSIVE, &pages, &written);
  if (code != SQLITE_OK) return failure(code, *path_, database_.get());
  *log_pages_ = 0;
  if (written < pages) return failure(SQLITE_BUSY, *path_, "", 0);  // as far as nobody reads
  return {};
}

Status Database::copy_to(const std::filesystem::path& path) {
  auto copy = prepare("VACUUM INTO ?");
  if (!copy) return tl::unexpected(copy.error());
  Status copied = copy->bind(0, std::string_view(path.native())).run();
  if (copied) return copied;
  const std::string why = why_not_writable(path);
  return fail(copied.error().code,
              path.string() + ": cannot be written: " + (why.empty() ? copied.error().message : why));
}

int Database::log_pages() const {
  return *log_pages_;
}

// ---- Reading

Result<Reading> Reading::begin(Database* database) {
  if (Status begun = database->execute("BEGIN"); !begun) return tl::unexpected(begun.error());
  Reading reading(database);
  const auto first = database->number("PRAGMA schema_version");  // the moment is that of the first look
  if (!first) return tl::unexpected(first.error());
  return reading;
}

Reading::~Reading() {
  // Nothing was written; who cannot end a reading meets that at the next one.
  if (database_ != nullptr) (void)database_->execute("ROLLBACK");
}

// ---- Transaction

Result<Transaction> Transaction::begin(Database* database) {
  if (Status begun = database->execute("BEGIN IMMEDIATE"); !begun) return tl::unexpected(begun.error());
  return Transaction(database);
}

Transaction::~Transaction() {
  // SQLite may have rolled back by itself (disk full): then this says so, which is no matter.
  if (database_ != nullptr) (void)database_->execute("ROLLBACK");
}

Status Transaction::commit() {
  Status committed = database_->execute("COMMIT");
  if (committed) database_ = nullptr;
  return committed;
}

bool is_write_failure(const Error& error) {
  return error.code == ErrorCode::kIo;
}

}  // namespace cairn::sqlite
