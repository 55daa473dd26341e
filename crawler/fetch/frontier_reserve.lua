-- KEYS: pace of a site. ARGV: now, delay, both in milliseconds.
local start = math.max(tonumber(redis.call('GET', KEYS[1]) or 0), tonumber(ARGV[1]))
redis.call('SET', KEYS[1], string.format('%.0f', start + ARGV[2]), 'EX', 3600)
return start - ARGV[1]
