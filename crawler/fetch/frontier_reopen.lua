-- KEYS: refused, queue, failed. ARGV: reason.
local count = 0
local found = redis.call('HGETALL', KEYS[1])
for i = 1, #found, 2 do
  if found[i + 1] == ARGV[1] then
    redis.call('HDEL', KEYS[1], found[i])
    redis.call('ZADD', KEYS[2], 0, found[i])
    redis.call('HINCRBY', KEYS[3], ARGV[1], -1)
    count = count + 1
  end
end
return count
