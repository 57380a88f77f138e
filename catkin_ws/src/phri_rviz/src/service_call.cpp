#include "service_call.hpp"

#include <ros/service_manager.h>
#include <ros/this_node.h>

#include <QDeadlineTimer>
#include <QNetworkProxy>
#include <QTcpSocket>
#include <QtEndian>
#include <utility>

namespace phri_rviz
{
namespace
{
constexpr int kLook = 50;                          // [ms] between two looks at give_up
constexpr std::uint32_t kLongestAnswer = 1 << 24;  // [B] a length beyond it is no length

class Call
{
public:
  Call(QString service, double timeout, const std::atomic<bool>& give_up)
    : service_(std::move(service)), timeout_(timeout), deadline_(qint64(timeout * 1000)), give_up_(give_up)
  {
  }

  bool open(const std::string& host, std::uint32_t port)
  {
    socket_.setProxy(QNetworkProxy::NoProxy);
    socket_.connectToHost(QString::fromStdString(host), quint16(port));
    // in one go: a wait that ends early also ends the attempt
    return socket_.waitForConnected(int(deadline_.remainingTime())) || fail("cannot be reached: is its node running?");
  }

  bool write(const char* bytes, std::size_t size)
  {
    socket_.write(bytes, qint64(size));
    while (socket_.bytesToWrite() > 0)
      if (!socket_.waitForBytesWritten(step()) && !goesOn())
        return false;
    return true;
  }

  bool read(std::vector<std::uint8_t>& bytes, std::size_t size)
  {
    while (std::size_t(socket_.bytesAvailable()) < size)
      if (!socket_.waitForReadyRead(step()) && !goesOn())
        return false;
    bytes.resize(size);
    socket_.read(reinterpret_cast<char*>(bytes.data()), qint64(size));
    return true;
  }

  bool readLength(std::uint32_t& length)
  {
    std::vector<std::uint8_t> bytes;
    if (!read(bytes, sizeof(length)))
      return false;
    length = qFromLittleEndian<std::uint32_t>(bytes.data());
    return length <= kLongestAnswer || fail("does not speak the protocol of ROS services");
  }

  bool fail(const QString& why)
  {
    error_ = service_ + ": " + why;
    return false;
  }

  const QString& error() const { return error_; }

private:
  int step() const { return int(qBound(qint64(0), deadline_.remainingTime(), qint64(kLook))); }

  /// After a wait that brought nothing: whether another one makes sense.
  bool goesOn()
  {
    if (give_up_)
      return fail("given up");
    if (deadline_.hasExpired())
      return fail(QString("no answer within %1 s").arg(timeout_));
    return socket_.state() == QAbstractSocket::ConnectedState || fail("its node broke the connection");
  }

  QString service_, error_;
  double timeout_;
  QDeadlineTimer deadline_;
  const std::atomic<bool>& give_up_;
  QTcpSocket socket_;
};

void append(QByteArray& bytes, const std::string& field)
{
  const quint32 length = qToLittleEndian(quint32(field.size()));
  bytes.append(reinterpret_cast<const char*>(&length), sizeof(length));
  bytes.append(field.data(), int(field.size()));
}

QByteArray header(const std::string& service, const std::string& type, const std::string& md5sum)
{
  QByteArray fields;
  append(fields, "callerid=" + ros::this_node::getName());
  append(fields, "service=" + service);
  append(fields, "md5sum=" + md5sum);
  append(fields, "type=" + type);
  QByteArray result;
  append(result, fields.toStdString());
  return result;
}

QString text(const std::vector<std::uint8_t>& bytes)
{
  return QString::fromUtf8(reinterpret_cast<const char*>(bytes.data()), int(bytes.size())).trimmed();
}

bool converse(Call& call, const QByteArray& header, const ros::SerializedMessage& request, ServiceReply& reply)
{
  std::uint32_t length = 0;
  std::vector<std::uint8_t> bytes;
  if (!call.write(header.data(), std::size_t(header.size())) || !call.readLength(length) || !call.read(bytes, length))
    return false;
  const QString fields = text(bytes);  // of its header; a refusal has error=... among them
  const int error = fields.indexOf("error=");
  if (error >= 0)
    return call.fail(fields.mid(error + 6));
  if (!call.write(reinterpret_cast<const char*>(request.buf.get()), request.num_bytes) || !call.read(bytes, 1))
    return false;
  const bool content = bytes[0] != 0;
  if (!call.readLength(length) || !call.read(reply.answer, length))
    return false;
  return content || call.fail(reply.answer.empty() ? "refused, without a reason" : text(reply.answer));
}
}  // namespace

ServiceReply callRaw(const std::string& service, const std::string& type, const std::string& md5sum,
                     const ros::SerializedMessage& request, double timeout, const std::atomic<bool>& give_up)
{
  ServiceReply reply;
  std::string host;
  std::uint32_t port = 0;
  const bool known = ros::ServiceManager::instance()->lookupService(service, host, port);
  Call call(QString::fromStdString(service), timeout, give_up);
  reply.success = known ? call.open(host, port) && converse(call, header(service, type, md5sum), request, reply)
                        : call.fail("there is no such service: is its node running?");
  reply.error = call.error();
  return reply;
}
}  // namespace phri_rviz
