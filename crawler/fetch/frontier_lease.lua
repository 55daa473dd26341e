-- KEYS: tasks, queue, leases. ARGV: now, the lease's end.
for _, key in ipairs(redis.call('ZRANGEBYSCORE', KEYS[3], '-inf', ARGV[1])) do
  redis.call('ZREM', KEYS[3], key)
  redis.call('ZADD', KEYS[2], 0, key)
end
local found = redis.call('ZPOPMIN', KEYS[2])
if #found == 0 then return false end
redis.call('ZADD', KEYS[3], ARGV[2], found[1])
return redis.call('HGET', KEYS[1], found[1])
